use atsplat_protocol::Preset;
use atsplat_rooms::{Layout, PictureCoding, Request, SceneKind, SceneSeed, Split, WriteOptions, write_dataset};
use atsplat_scene::WarningKind;

use super::*;

const CONFIG: &str = r#"
    title = "a dataset with a missing picture"
    seed = 1
    steps = 6
    batch = 2

    [model]
    base = "nano"

    [model.changes]
    resolution = [32, 32]
    transformer = { dim = 32, head-dim = 16 }

    [[data]]
    [data.source.dataset]
    path = "DATA"
    preset = "PRESET"
    views = { context = [2, 2], targets = 1, gaps = { min = 2, max = 3 }, inset = 1 }

    [evaluation]
    every = 6
    samples = 1
    source.dataset = { path = "DATA", preset = "PRESET", views = { context = [2, 2], targets = 1, gaps = { min = 2, max = 3 } } }
"#;

#[test]
fn warnings_of_datasets_reach_the_caller_once_per_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (data, preset) = (folder.path().join("data"), folder.path().join("tiny.toml"));
    let seed = SceneSeed { split: Split::Train, number: 0 };
    let size = atsplat_camera::ImageSize { width: 32, height: 32 };
    let request = Request { size, samples: 1, frames: 12, ..Request::new(SceneKind::Rooms, seed) };
    let options = WriteOptions { layout: Layout::Re10k, coding: PictureCoding::Png, depth: false };
    write_dataset(&data, [request], &options, &mut Warnings::new(), |_, _| ()).unwrap();
    let name = "66667.png";
    std::fs::remove_file(data.join("train").join(seed.key(SceneKind::Rooms)).join(name)).unwrap();
    let text = Preset::text_of("re10k-2v-256").unwrap();
    let text = text.replace("height = 256, width = 256", "height = 32, width = 32");
    let text = text.replace("expected-size = { width = 640, height = 360 }\n", "");
    std::fs::write(&preset, text).unwrap();
    let config = CONFIG.replace("DATA", &data.join("train").to_string_lossy());
    let config = TrainConfig::from_toml(&config.replace("PRESET", &preset.to_string_lossy())).unwrap();

    let mut trainer = Trainer::new(config, &folder.path().join("run"), &Start::Fresh).unwrap();
    assert_eq!(trainer.warnings().count(WarningKind::MissingPicture), 1, "the evaluation's source");
    let mut notices = Vec::new();
    let mut on_event = |event: &Event<'_>| {
        if let Event::Notice(text) = event {
            notices.push((*text).to_owned());
        }
    };
    assert!(trainer.run(Limits::default(), &mut on_event).unwrap());
    assert_eq!(trainer.warnings().count(WarningKind::MissingPicture), 2, "both sources, however often they are read");
    assert_eq!(notices.len(), 2, "{notices:?}");
    for (notice, count) in notices.iter().zip(1..) {
        let expected =
            format!("warning: {count} × missing-picture; the first: {}: frame 2: no ", seed.key(SceneKind::Rooms));
        assert!(notice.starts_with(&expected) && notice.ends_with(name), "{notice}");
    }
}
