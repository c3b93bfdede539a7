//! The live view in a real browser, compared pixel by pixel with our renderer.

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_eval::live::{LiveCamera, LiveScene, LiveStage};
use atsplat_numeric::{Extremes as _, SplitMix64, Tolerance};
use atsplat_pixels::ImageU8;
use atsplat_splat::{GaussianParts, Gaussians, RenderOptions, RendererConstants, View, reference, sh};
use glam::{DMat3, DVec3};

use super::browser::{chromium, report_in_frame};
use super::*;

/// 8-bit levels by which the worst pixel of the page may differ from the renderer, and the mean of all: Gaussians are stored in
/// steps, pixels in 8 bits.
const WORST: f64 = 8.0;
const MEAN: f64 = 0.6;
/// The page's colours of Gaussians by the block that made them.
const BLOCKS: [[f32; 3]; 3] = [[0.45, 0.48, 0.52], [0.0, 0.45, 0.70], [0.90, 0.62, 0.0]];

/// Gaussians in front of the cameras, of all sizes, with colours that differ from left to right and from near to far.
fn gaussians(count: u32) -> Gaussians {
    let mut random = SplitMix64::new(11);
    let mut draw = |low: f32, high: f32| low + (high - low) * random.unit_f32();
    let mut parts = GaussianParts::default();
    for _ in 0..count {
        let mean = [draw(-1.2, 1.2), draw(-0.8, 0.8), draw(1.5, 5.0)];
        parts.means.push(mean);
        parts.quaternions.push([0; 4].map(|_| draw(-1.0, 1.0)));
        parts.log_scales.push([0; 3].map(|_| draw(-5.0, -1.6)));
        parts.opacity_logits.push(draw(-3.0, 4.0));
        parts.sh.push([mean[0], mean[1], 3.0 - mean[2]].map(|colour| colour + draw(-0.6, 0.6)));
    }
    Gaussians::new(parts).unwrap()
}

fn view(yaw: f64, centre: [f64; 3]) -> View {
    let rotation = DMat3::from_rotation_y(yaw);
    let pose = CameraFromWorld::new(rotation, -(rotation * DVec3::from(centre))).unwrap();
    let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(0.9, 1.3, 0.46, 0.57).unwrap());
    View { camera, size: ImageSize { width: 120, height: 80 } }
}

fn options() -> RenderOptions {
    let background = [0.1, 0.2, 0.4];
    RenderOptions { constants: RendererConstants::default(), background, ..RenderOptions::default() }
}

/// The same with the colour of the block that made each.
fn coloured(gaussians: &Gaussians, block: impl Fn(usize) -> usize) -> Gaussians {
    let mut parts = gaussians.parts().clone();
    for (at, colour) in parts.sh.iter_mut().enumerate() {
        #[expect(clippy::cast_possible_truncation, reason = "a coefficient")]
        let coefficient = |level| ((f64::from(level) - 0.5) / sh::C0) as f32;
        *colour = BLOCKS[block(at)].map(coefficient);
    }
    Gaussians::new(parts).unwrap()
}

/// Two grey and coloured columns: red, green, then blue.
fn film() -> Film {
    let plain = |colour: [u8; 3]| ImageU8::new(16, 16, colour.repeat(256)).unwrap();
    let frame = |at| vec![plain([90; 3]), plain([0, 1, 2].map(|channel| if channel == at { 200 } else { 40 }))];
    let columns = ["grey", "coloured"].map(str::to_owned).to_vec();
    Film { name: "film".to_owned(), columns, note: "path".to_owned(), frames: (0..3).map(frame).collect() }
}

/// Compares the page's pixels with the reference renderer's from the pose that the page reports; returns the pose.
fn compared(name: &str, report: &Value, gaussians: &Gaussians, base: &View) -> CameraFromWorld {
    let numbers =
        |value: &Value| value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect::<Vec<f64>>();
    assert_eq!(numbers(&report["size"]), [120.0, 80.0]);
    let rows: [f64; 12] = numbers(&report["camera_from_world"]).try_into().unwrap();
    let rotation = DMat3::from_cols_array(&[0, 1, 2, 4, 5, 6, 8, 9, 10].map(|at| rows[at])).transpose();
    let pose = CameraFromWorld::new(rotation, DVec3::new(rows[3], rows[7], rows[11])).unwrap();
    let mut view = *base;
    view.camera.camera_from_world = pose;
    let expected = reference::render(gaussians, &view, &options()).unwrap();
    let found = STANDARD.decode(report["pixels"].as_str().unwrap()).unwrap();
    let level = |value: f64| value.clamp(0.0, 1.0) * 255.0;
    let differences: Vec<f64> = expected
        .rgb
        .iter()
        .zip(found.chunks_exact(4))
        .flat_map(|(pixel, page)| [0, 1, 2].map(|at| (level(pixel[at]) - f64::from(page[at])).abs()))
        .collect();
    assert_eq!(differences.len(), 120 * 80 * 3);
    let worst = differences.iter().copied().fold(0.0, f64::maximum_of);
    let mean = differences.iter().sum::<f64>() / differences.len() as f64;
    println!("{name}: worst {worst:.2}, mean {mean:.3} of 255");
    assert!(worst <= WORST && mean <= MEAN, "{name}: worst {worst:.2}, mean {mean:.3} of 255");
    pose
}

#[test]
fn a_browser_turns_the_live_view_and_draws_what_our_renderer_draws() {
    let Some(chromium) = chromium("a_browser_turns_the_live_view_and_draws_what_our_renderer_draws") else { return };
    let [all, few] = [gaussians(500), gaussians(200)];
    let views = [view(0.0, [0.0; 3]), view(0.35, [0.4, -0.1, 0.8])];
    let labels = |count: usize| (0..count / 10).map(|token| (u8::try_from(token % 3).unwrap(), 40)).collect::<Vec<_>>();
    let focus = DVec3::new(0.1, -0.05, 3.0);
    let scene = LiveScene {
        cameras: views
            .iter()
            .enumerate()
            .map(|(at, view)| LiveCamera::of(at == 0, at, view, &options()).unwrap())
            .collect(),
        focus: focus.to_array(),
        options: options(),
        stages: [(0, &few), (1, &all)]
            .map(|(blocks, shown)| LiveStage::of(blocks, shown, 10, &labels(shown.len()), 1.0 / 255.0))
            .into(),
        uncertainty: Some([0.1, 0.9]),
    };
    let image = LiveImage {
        title: "target".to_owned(),
        note: "<i>".to_owned(),
        image: ImageU8::new(2, 1, vec![9; 6]).unwrap(),
    };
    let live = [LiveTrial { title: "room".to_owned(), scene, images: vec![image], film: Some(film()) }];
    let page = Page {
        title: "Live".to_owned(),
        tables: &[],
        plots: &[],
        sections: &[],
        live: &live,
        stores: &[],
        max_bytes: usize::MAX,
    };
    let page = page.write_with(Some(include_str!("live_selftest.js"))).unwrap();
    assert!(page.contains("&lt;i&gt;"));
    let report = report_in_frame(&chromium, &page, 1000);
    assert!(report.get("error").is_none(), "{:?}", report["error"]);
    assert_eq!(report["segments"], true, "cameras are drawn");
    assert!(report["note"].as_str().unwrap().starts_with("before block 1: 2"), "{}", report["note"]);

    // The film's second column, frame by frame.
    for (at, pixel) in report["film"].as_array().unwrap().iter().enumerate() {
        let expected = [0, 1, 2].map(|channel| if channel == at { 200.0 } else { 40.0 });
        let found = [0, 1, 2].map(|channel| pixel[channel].as_f64().unwrap());
        Tolerance::absolute(8.0).assert(found, expected, "a frame of the film");
    }
    assert_eq!(report["played"], "Pause 0", "from the last frame to the first");

    let by_name = |name: &str, gaussians: &Gaussians| compared(name, &report[name], gaussians, &views[0]);
    let first = by_name("first", &all);
    by_name("second", &all);
    by_name("before", &few);
    by_name("by_block", &coloured(&all, |at| at / 10 % 3));
    assert_eq!(by_name("reset", &all).to_rows().map(f64::to_bits), first.to_rows().map(f64::to_bits));

    // A tenth of the canvas is a tenth of half a turn: the scene follows the finger, so the camera moves to the left.
    let centres =
        ["first", "right", "right_and_down", "nearer"].map(|name| by_name(name, &all).inverse().centre() - focus);
    let close = Tolerance::absolute(1e-6);
    let angle = std::f64::consts::PI / 10.0;
    close.assert(
        [centres[1].normalize().dot(centres[0].normalize()).acos()],
        [horizontal_angle(centres[0], angle)],
        "turned",
    );
    assert!(centres[1].x < centres[0].x && (centres[1].y - centres[0].y).abs() < 1e-9);
    assert!(centres[2].y < centres[1].y - 0.1, "dragged down, the camera rises");
    close.assert([centres[1].length(), centres[2].length()], [centres[0].length(); 2], "at the same distance");
    close.assert([centres[3].length()], [centres[2].length() * (-0.2f64).exp()], "nearer");
    assert_eq!(report["released"]["camera_from_world"], report["right_and_down"]["camera_from_world"]);
}

/// The angle between a direction and itself turned about the vertical.
fn horizontal_angle(direction: DVec3, angle: f64) -> f64 {
    let unit = direction.normalize();
    (unit.y * unit.y + (1.0 - unit.y * unit.y) * angle.cos()).acos()
}
