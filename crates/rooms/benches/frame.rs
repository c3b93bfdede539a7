//! A 256×256 frame with 4 samples a pixel on two threads: the image with the effects that its scene needs,
//! with all and without any, the geometry alone, and the building of a scene.

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]

use std::hint::black_box;

use atsplat_rooms::{EffectChoice, Request, SceneKind, SceneSeed, Simulation, Split};
use criterion::{Criterion, criterion_group, criterion_main};

/// Six scenes, one after another, because one scene is not representative.
fn requests(kind: SceneKind, effects: &EffectChoice) -> Vec<Request> {
    let request =
        |number| Request { effects: effects.clone(), ..Request::new(kind, SceneSeed { split: Split::Train, number }) };
    (0..6).map(request).collect()
}

fn frames(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    for kind in SceneKind::ALL {
        for (name, effects) in
            [("needed", EffectChoice::Auto), ("all", EffectChoice::All), ("none", EffectChoice::None)]
        {
            let scenes: Vec<Simulation> =
                requests(kind, &effects).into_iter().map(|r| Simulation::new(r).expect("a scene")).collect();
            let mut next = scenes.iter().cycle();
            c.bench_function(&format!("{kind}, effects {name}: image"), |b| {
                b.iter(|| pool.install(|| black_box(next.next().expect("a scene").image(30).expect("an image"))));
            });
            if effects == EffectChoice::None {
                c.bench_function(&format!("{kind}: geometry"), |b| {
                    b.iter(|| {
                        pool.install(|| black_box(next.next().expect("a scene").geometry(30).expect("geometry")))
                    });
                });
            }
        }
        let requests = requests(kind, &EffectChoice::Auto);
        let mut next = requests.iter().cycle();
        c.bench_function(&format!("{kind}: building a scene"), |b| {
            b.iter(|| {
                pool.install(|| black_box(Simulation::new(next.next().expect("a request").clone()).expect("a scene")))
            });
        });
    }
}

criterion_group! { name = benches; config = Criterion::default().sample_size(12); targets = frames }
criterion_main!(benches);
