//! The messages between atsplat and a method's process: one JSON object per line.
//!
//! The process begins with a [`Hello`]. Then it is given a [`Request`] for each trial on its standard input, and writes an
//! [`Answer`] to its standard output. `docs/methods.md` describes them for authors of methods.

use std::collections::BTreeMap;

use atsplat_camera::{Camera, ImageSize};
use atsplat_files::Sha256Digest;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::method::TrialInput;

/// Version of the protocol, which a process states first.
pub(super) const VERSION: u32 = 1;
/// Characters of a line that are quoted in a message.
const QUOTED: usize = 160;
/// How much longer than an answer the stages that it states may be, since clocks differ: in seconds, and as a part of the answer's
/// time.
const CLOCK_TOLERANCE_SECS: f64 = 0.001;
const CLOCK_TOLERANCE: f64 = 0.01;

/// How a process describes itself when it has started.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Hello {
    /// [`VERSION`].
    pub(super) atsplat: u32,
    pub(super) name: String,
    /// Version of the method; results of two versions do not share a store.
    pub(super) version: String,
    pub(super) gives: OutputKind,
    /// The published method whose pose normalisation, planes and renderer it uses, as in the preset's `[[methods]]`.
    #[serde(default)]
    pub(super) setting: Option<String>,
    #[serde(default)]
    pub(super) weights_sha256: Option<String>,
    #[serde(default)]
    pub(super) untrained: bool,
    #[serde(default)]
    pub(super) deterministic: bool,
}

/// What a process answers with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum OutputKind {
    /// Images of the targets.
    Images,
    /// Gaussians, which atsplat renders.
    Gaussians,
}

/// A trial, without target images.
#[derive(Debug, Serialize)]
pub(super) struct Request<'a> {
    /// Position of the entry in the index, whatever the order and number of requests.
    pub(super) trial: u64,
    /// Name of the protocol.
    preset: &'a str,
    scene: &'a str,
    entry: usize,
    /// Where the images are, and where the answer's files go.
    folder: String,
    context: Vec<View>,
    targets: Vec<View>,
    near: f64,
    far: f64,
}

/// A camera with the size of its image.
#[derive(Debug, Serialize)]
struct View {
    frame: usize,
    width: u32,
    height: u32,
    /// Rows of the 3×3 matrix, in pixels; the centre of the first pixel is at (0.5, 0.5).
    intrinsics: [[f64; 3]; 3],
    /// Rows of the 4×4 matrix; OpenCV axes.
    world_from_camera: [[f64; 4]; 4],
    /// The lens of its image, unless that is a pinhole's.
    #[serde(skip_serializing_if = "Option::is_none")]
    lens: Option<Lens>,
    /// The context image's file.
    #[serde(skip_serializing_if = "Option::is_none")]
    image: Option<String>,
}

/// Lens distortion, as [`Distortion::in_opencv_order`](atsplat_camera::Distortion::in_opencv_order) has it.
#[derive(Debug, Serialize)]
struct Lens {
    model: &'static str,
    coefficients: Vec<f64>,
}

/// The answer of a process to a request.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Answer {
    /// The name of a `.npy` file or of a folder.
    Images(String),
    /// The name of a file of Gaussians.
    Gaussians(String),
    /// It cannot do this kind of trial.
    NotApplicable(String),
    /// It failed.
    Error(String),
}

/// An answer with the seconds of its stages, by name.
pub(super) type TimedAnswer = (Answer, BTreeMap<String, f64>);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AnswerLine {
    trial: u64,
    images: Option<String>,
    gaussians: Option<String>,
    not_applicable: Option<String>,
    error: Option<String>,
    #[serde(default)]
    seconds: BTreeMap<String, f64>,
}

impl Hello {
    pub(super) fn parse(line: &str) -> Result<Self, String> {
        let stated: serde_json::Value = parsed(line, "a first line such as {\"atsplat\": 1, \"name\": …}")?;
        // The version comes first: a newer one may have other fields.
        if stated.get("atsplat").and_then(serde_json::Value::as_u64) != Some(VERSION.into()) {
            return Err(format!(
                "expected \"atsplat\": {VERSION}, the version of the protocol, found {}",
                quoted(line)
            ));
        }
        let hello: Self = parsed(line, "a first line such as {\"atsplat\": 1, \"name\": …}")?;
        match hello.weights_sha256.as_ref().map(|weights| (weights, weights.parse::<Sha256Digest>())) {
            Some((weights, Err(error))) => Err(format!("weights_sha256: {error}, found {}", quoted(weights))),
            _ => Ok(hello),
        }
    }
}

impl<'a> Request<'a> {
    /// The message of a trial whose context images are the `files` in `folder`.
    pub(super) fn new(input: &TrialInput<'a>, folder: String, files: Vec<String>) -> Self {
        let context = input.trial.context().iter().zip(files);
        let context = context.map(|(view, file)| View::of(view.frame, &view.camera, view.size, Some(file)));
        let targets = input.trial.targets().iter();
        let targets = targets.map(|target| View::of(target.frame, &target.camera, target.size, None));
        Self {
            trial: input.trial.position() as u64,
            preset: &input.preset.name,
            scene: input.trial.scene(),
            entry: input.trial.entry_number(),
            folder,
            context: context.collect(),
            targets: targets.collect(),
            near: input.trial.near_far().near,
            far: input.trial.near_far().far,
        }
    }

    /// The trial's number, scene and entry, for messages.
    pub(super) fn label(&self) -> String {
        format!("{} (scene {:?}, entry {})", self.trial, self.scene, self.entry)
    }

    /// The message's line.
    #[expect(clippy::expect_used, reason = "numbers, texts and lists of them")]
    pub(super) fn line(&self) -> String {
        let mut line = serde_json::to_string(self).expect("a request is representable in JSON");
        line.push('\n');
        line
    }
}

impl OutputKind {
    /// The name in messages.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Images => "images",
            Self::Gaussians => "gaussians",
        }
    }
}

impl View {
    fn of(frame: usize, camera: &Camera, size: ImageSize, image: Option<String>) -> Self {
        let pixels = camera.intrinsics.pixel_from_normalized(size);
        let [a, b, c, x, d, e, f, y, g, h, i, z] = camera.camera_from_world.inverse().to_rows();
        Self {
            frame,
            width: size.width,
            height: size.height,
            intrinsics: [[pixels.fx, 0.0, pixels.cx], [0.0, pixels.fy, pixels.cy], [0.0, 0.0, 1.0]],
            world_from_camera: [[a, b, c, x], [d, e, f, y], [g, h, i, z], [0.0, 0.0, 0.0, 1.0]],
            lens: camera.distortion.in_opencv_order().map(|(model, coefficients)| Lens { model, coefficients }),
            image,
        }
    }
}

impl Answer {
    /// The name of its field.
    pub(super) const fn name(&self) -> &'static str {
        match self {
            Self::Images(_) => OutputKind::Images.name(),
            Self::Gaussians(_) => OutputKind::Gaussians.name(),
            Self::NotApplicable(_) => "not_applicable",
            Self::Error(_) => "error",
        }
    }

    /// The answer to the request of this trial.
    pub(super) fn parse(line: &str, trial: u64) -> Result<TimedAnswer, String> {
        let expected = format!("a line such as {{\"trial\": {trial}, \"images\": …}} on its standard output");
        let answer: AnswerLine = parsed(line, &expected)?;
        if answer.trial != trial {
            return Err(format!(
                "expected the answer to trial {trial}, found that to trial {}: another number, or an extra line after an earlier \
                 answer",
                answer.trial
            ));
        }
        if let Some((name, secs)) = answer.seconds.iter().find(|(_, secs)| !secs.is_finite() || **secs < 0.0) {
            return Err(format!("{name}: expected seconds of at least 0, found {secs}"));
        }
        let parts = [
            answer.images.map(Self::Images),
            answer.gaussians.map(Self::Gaussians),
            answer.not_applicable.map(Self::NotApplicable),
            answer.error.map(Self::Error),
        ];
        let mut parts = parts.into_iter().flatten();
        match (parts.next(), parts.next()) {
            (Some(part), None) => Ok((part, answer.seconds)),
            _ => Err(format!("expected one of images, gaussians, not_applicable and error, found {}", quoted(line))),
        }
    }
}

/// Rejects stages that take longer than their answer, which took `wall_secs`; they do not overlap. Measured seconds are logged and not in
/// the message: rows of equal runs are equal.
pub(super) fn check_seconds(stages: &BTreeMap<String, f64>, wall_secs: f64) -> Result<(), String> {
    let longest = wall_secs * (1.0 + CLOCK_TOLERANCE) + CLOCK_TOLERANCE_SECS;
    let (names, secs) = match stages.iter().find(|(_, secs)| **secs > longest) {
        Some((name, secs)) => (name.clone(), *secs),
        None => (stages.keys().map(String::as_str).collect::<Vec<_>>().join(" + "), stages.values().sum()),
    };
    if secs <= longest {
        return Ok(());
    }
    tracing::info!(%names, secs, wall_secs, "stages that are longer than their answer");
    Err(format!(
        "{names}: expected at most the seconds that the answer took, found more: \"seconds\" are seconds, not milliseconds, of stages \
         that do not overlap"
    ))
}

fn parsed<T: DeserializeOwned>(line: &str, expected: &str) -> Result<T, String> {
    serde_json::from_str(line).map_err(|error| format!("expected {expected}, found {} ({error})", quoted(line)))
}

/// The beginning of a line.
pub(super) fn quoted(line: &str) -> String {
    let line = line.trim_end();
    let mut quoted: String = line.chars().take(QUOTED).collect();
    if quoted.len() < line.len() {
        quoted.push('…');
    }
    format!("{quoted:?}")
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{CameraFromWorld, Distortion, NormalizedIntrinsics};

    use super::*;

    #[test]
    fn a_hello_states_the_version_first() {
        let hello = Hello::parse(r#"{"atsplat": 1, "name": "a", "version": "2", "gives": "gaussians"}"#).unwrap();
        assert_eq!((hello.name.as_str(), hello.gives, hello.untrained), ("a", OutputKind::Gaussians, false));
        let refused = |line: &str| Hello::parse(line).unwrap_err();
        assert!(refused(r#"{"atsplat": 2, "names": ["a"]}"#).contains("\"atsplat\": 1"));
        assert!(refused(r#"{"atsplat": 1, "name": "a", "version": "2", "gives": "meshes"}"#).contains("meshes"));
        assert!(refused(r#"{"atsplat": 1, "name": "a", "gives": "images"}"#).contains("version"));
        assert!(refused("Loading weights\n").contains("Loading weights\""));
        let with = |weights: &str| {
            Hello::parse(&format!(
                r#"{{"atsplat": 1, "name": "a", "version": "2", "gives": "images", "weights_sha256": {weights}}}"#
            ))
        };
        let hash = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(with(&format!("\"{hash}\"")).unwrap().weights_sha256.as_deref(), Some(hash));
        assert_eq!(with("null").unwrap().weights_sha256, None);
        let expected = "weights_sha256: expected 64 hexadecimal digits, found \"re10k.ckpt\"";
        assert_eq!(with("\"re10k.ckpt\""), Err(expected.to_owned()));
    }

    #[test]
    fn a_view_has_its_lens_unless_it_is_a_pinhole() {
        let pinhole =
            Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(0.5, 1.0, 0.5, 0.5).unwrap());
        let size = ImageSize { width: 64, height: 32 };
        let line = |camera: &Camera| serde_json::to_value(View::of(3, camera, size, None)).unwrap();
        assert_eq!(line(&pinhole).get("lens"), None);
        let distortion = Distortion::OpenCv { k1: 0.1, k2: 0.2, k3: 0.3, p1: 0.4, p2: 0.5 };
        let expected = serde_json::json!({ "model": "opencv", "coefficients": [0.1, 0.2, 0.4, 0.5, 0.3] });
        assert_eq!(line(&Camera { distortion, ..pinhole })["lens"], expected);
        let distortion = Distortion::Fisheye { k: [0.1, 0.2, 0.3, 0.4] };
        let expected = serde_json::json!({ "model": "fisheye", "coefficients": [0.1, 0.2, 0.3, 0.4] });
        assert_eq!(line(&Camera { distortion, ..pinhole })["lens"], expected);
    }

    #[test]
    fn an_answer_is_one_of_four_and_belongs_to_its_trial() {
        let (answer, seconds) =
            Answer::parse(r#"{"trial": 3, "images": "a.npy", "seconds": {"encode": 0.5}}"#, 3).unwrap();
        assert_eq!((answer, seconds["encode"]), (Answer::Images("a.npy".to_owned()), 0.5));
        let refused = |line: &str| Answer::parse(line, 3).unwrap_err();
        assert!(
            refused(r#"{"trial": 4, "images": "a.npy"}"#).contains("trial 3, found that to trial 4: another number")
        );
        assert!(refused(r#"{"trial": 3}"#).contains("one of images"));
        assert!(refused(r#"{"trial": 3, "images": "a", "error": "b"}"#).contains("one of images"));
        assert!(refused(r#"{"trial": 3, "images": "a", "time": 1}"#).contains("time"));
        assert!(refused(r#"{"trial": 3, "images": "a", "seconds": {"encode": -1}}"#).contains("-1"));
        assert!(refused(r#"{"trial": 3, "images": NaN}"#).contains("NaN"));
        let long = refused(&"x".repeat(1000));
        assert!(long.len() < 400 && long.contains('…'), "{long}");
    }

    #[test]
    fn stages_that_take_longer_than_their_answer_are_rejected() {
        let check = |stages: &[(&str, f64)], wall_secs: f64| {
            check_seconds(&stages.iter().map(|(name, secs)| ((*name).to_owned(), *secs)).collect(), wall_secs)
        };
        assert_eq!(check(&[], 0.0), Ok(()));
        assert_eq!(check(&[("encode", 0.12), ("render", 0.03)], 0.15), Ok(()));
        assert_eq!(check(&[("encode", 10.1)], 10.0), Ok(()), "one in a hundred");
        assert_eq!(check(&[("encode", 0.005)], 0.0041), Ok(()), "a millisecond");
        let refused = |stages: &[(&str, f64)], wall_secs: f64| check(stages, wall_secs).unwrap_err();
        assert!(refused(&[("encode", 0.0062)], 0.005).starts_with("encode: expected at most "));
        assert_eq!(
            refused(&[("encode", 1000.0), ("render", 0.001)], 0.004_57),
            "encode: expected at most the seconds that the answer took, found more: \"seconds\" are seconds, not milliseconds, of \
             stages that do not overlap"
        );
        let both = refused(&[("encode", 0.75), ("render", 0.5)], 1.0);
        assert!(both.starts_with("encode + render: expected "), "{both}");
        assert_eq!(
            refused(&[("encode", 10.2)], 10.0),
            refused(&[("encode", 10.3)], 10.1),
            "rows of two runs are equal"
        );
    }
}
