use std::collections::BTreeMap;
use std::fmt;

use atsplat_camera::ImageSize;
use atsplat_numeric::{median, spread};
use atsplat_pixels::ImageU8;
use atsplat_scene::geometry::{
    Convention, ConventionFit, ConventionScore, MatchedPair, PointMatch, View, fitting_convention, score_conventions,
};
use atsplat_scene::{Frame, Scene, SceneError, WarningKind, Warnings};
use serde::Serialize;

use super::OpenCvError;
use super::matching::{Features, MatchOptions, detect, epipolar_inliers, match_mutual};

/// Gaps that [`PairChoice::Spread`] tries, widest first: wide baselines distinguish interpretations, narrow ones still
/// match.
const GAPS: [usize; 7] = [64, 32, 16, 8, 4, 2, 1];

/// Which pairs of frames are compared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PairChoice {
    /// From this many frames, evenly spread over those with an image, the widest gap of 64, 32, …, 1 such frames that
    /// still matches and was not measured from another frame. The choice depends on images only, because poses may be wrong.
    Spread(usize),
    /// These positions in [`Scene::frames`].
    Listed(Vec<(usize, usize)>),
}

/// Options of [`check_geometry`].
#[derive(Clone, Debug, PartialEq)]
pub struct GeometryCheckOptions {
    /// Which frames are compared.
    pub pairs: PairChoice,
    /// How features are matched.
    pub matching: MatchOptions,
    /// A pair is skipped if it has fewer matches after the inlier filter.
    pub min_matches: usize,
    /// A pair is skipped if the filter keeps less than this fraction of its matches, in [0, 1]: the images then hardly
    /// show the same place.
    pub min_inlier_fraction: f64,
    /// A spread pair is skipped if less than this fraction of the features are matched, in [0, 1], counted in the image
    /// with fewer features. A repeated pattern (wallpaper, tiles) matches itself one period away, all inliers of one
    /// fundamental matrix, but only tens of features among thousands.
    pub min_feature_fraction: f64,
    /// A spread pair is skipped if the median motion of its points is below this fraction of the diagonal: every
    /// interpretation explains images that hardly differ.
    pub min_motion: f64,
}

impl Default for GeometryCheckOptions {
    fn default() -> Self {
        Self {
            pairs: PairChoice::Spread(12),
            matching: MatchOptions::default(),
            min_matches: 20,
            min_inlier_fraction: 0.5,
            min_feature_fraction: 0.05,
            min_motion: 0.02,
        }
    }
}

/// The measurement of one pair of frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairCheck {
    /// Positions in [`Scene::frames`].
    pub frames: (usize, usize),
    /// Mutual matches that passed the ratio test.
    pub tentative: usize,
    /// Tentative matches that agree with one fundamental matrix.
    pub matches: usize,
    /// Median motion of the matched points between the images, in pixels.
    pub motion_px: f64,
    /// Median symmetric epipolar distance under the declared cameras; `None` if their centres coincide.
    pub declared_px: Option<f64>,
}

/// A pair that could not be used, or a spread frame of which no pair could.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SkippedPair {
    /// Positions in [`Scene::frames`]; the second is `None` if no partner was found for the first.
    pub frames: (usize, Option<usize>),
    /// Why.
    pub reason: String,
}

/// How well a scene's cameras explain its images, as declared and under common mistakes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GeometryCheck {
    /// Scene key.
    pub scene: String,
    /// Measured pairs.
    pub pairs: Vec<PairCheck>,
    /// Skipped pairs.
    pub skipped: Vec<SkippedPair>,
    /// One score per interpretation that applies, the declared one first.
    pub scores: Vec<ConventionScore>,
    /// Which interpretation explains the images.
    #[serde(flatten)]
    pub fit: ConventionFit,
}

impl GeometryCheck {
    /// The score of one interpretation, if it applies.
    pub fn score(&self, convention: Convention) -> Option<ConventionScore> {
        self.scores.iter().find(|score| score.convention == convention).copied()
    }
}

/// Matches features between pairs of a scene's frames and measures their distance from the epipolar lines of the
/// cameras, as declared and under every common mistake.
///
/// Matches are mutual and pass the ratio test; outliers are then removed by a fundamental matrix fitted to the matches
/// alone, once on raw points and, if a lens is declared, once on undistorted ones: an inlier of either stays. So no
/// interpretation affects the matches that it is measured on.
///
/// `image_of` decodes the frame at a position. The image may be scaled, but not cropped, because intrinsics are
/// normalised. A frame that cannot be decoded is reported in `warnings` and its pairs are skipped, as are those with a frame that
/// the scene does not have.
///
/// # Errors
/// [`OpenCvError::Call`].
pub fn check_geometry(
    scene: &Scene,
    mut image_of: impl FnMut(usize) -> Result<ImageU8, SceneError>,
    options: &GeometryCheckOptions,
    warnings: &mut Warnings,
) -> Result<GeometryCheck, OpenCvError> {
    let mut matcher = Matcher {
        scene,
        image_of: &mut image_of,
        options,
        warnings,
        described: BTreeMap::new(),
        measured: Vec::new(),
        skipped: Vec::new(),
    };
    match &options.pairs {
        PairChoice::Listed(pairs) => {
            for frames in pairs {
                match matcher.matched(*frames)? {
                    Ok(pair) => matcher.measured.push(pair),
                    Err(reason) => matcher.skipped.push(SkippedPair { frames: (frames.0, Some(frames.1)), reason }),
                }
            }
        }
        PairChoice::Spread(anchors) => {
            let candidates = frames_with_images(scene);
            for anchor in spread(candidates.len(), *anchors) {
                matcher.measure_widest(&candidates, anchor)?;
            }
        }
    }
    let Matcher { measured, skipped, .. } = matcher;
    let (pairs, matched): (Vec<_>, Vec<_>) = measured.into_iter().unzip();
    let scores = score_conventions(&matched);
    let diagonal = median(matched.iter().map(|pair| pair.first.diagonal()));
    let fit = diagonal.map_or(ConventionFit::TooFewMatches, |px| fitting_convention(&scores, px, options.min_matches));
    Ok(GeometryCheck { scene: scene.key.clone(), pairs, skipped, scores, fit })
}

fn frames_with_images(scene: &Scene) -> Vec<usize> {
    (0..).zip(&scene.frames).filter(|(_, frame)| frame.image.is_available()).map(|(position, _)| position).collect()
}

/// Decodes each frame and computes its features once, and collects the pairs.
struct Matcher<'a> {
    scene: &'a Scene,
    image_of: &'a mut dyn FnMut(usize) -> Result<ImageU8, SceneError>,
    options: &'a GeometryCheckOptions,
    warnings: &'a mut Warnings,
    described: BTreeMap<usize, Described>,
    measured: Vec<Measured>,
    skipped: Vec<SkippedPair>,
}

type Measured = (PairCheck, MatchedPair);

/// A frame's view and features, or why there are none.
type Described = Result<(View, Features), String>;

impl Matcher<'_> {
    /// Measures the pair with the widest usable gap from the candidate at `anchor`, forwards or, near the end, backwards, that
    /// is not measured yet: backwards it may be the pair of an earlier anchor, and would count twice.
    fn measure_widest(&mut self, candidates: &[usize], anchor: usize) -> Result<(), OpenCvError> {
        let first = candidates[anchor];
        let mut reason = "no other frame has an image".to_owned();
        let mut is_measured = false;
        for gap in GAPS {
            let forwards = candidates.get(anchor + gap).map(|other| (first, *other));
            let backwards = || anchor.checked_sub(gap).and_then(|other| candidates.get(other)).map(|o| (*o, first));
            let Some(frames) = forwards.or_else(backwards) else { continue };
            if self.measured.iter().any(|(check, _)| check.frames == frames) {
                is_measured = true;
                continue;
            }
            match self.matched(frames)?.and_then(|measured| self.informative(measured)) {
                Ok(pair) => {
                    self.measured.push(pair);
                    return Ok(());
                }
                Err(why) => reason = format!("at every gap; last with frame {}: {why}", other_of(frames, first)),
            }
        }
        if !is_measured {
            self.skipped.push(SkippedPair { frames: (first, None), reason });
        }
        Ok(())
    }

    /// The matches between two frames, or why they cannot be used.
    fn matched(&mut self, frames: (usize, usize)) -> Result<Result<Measured, String>, OpenCvError> {
        self.describe(frames.0)?;
        self.describe(frames.1)?;
        let described = self.of(frames.0).and_then(|first| Ok((first, self.of(frames.1)?)));
        let ((first, first_features), (second, second_features)) = match described {
            Ok(described) => described,
            Err(reason) => return Ok(Err(reason)),
        };
        let tentative = match_mutual(first_features, second_features, self.options.matching.ratio)?;
        let matches = agreeing(&tentative, first, second, self.options.matching.inlier_px)?;
        let GeometryCheckOptions { min_matches, min_inlier_fraction, .. } = *self.options;
        let motion = median(matches.iter().map(|m| m.first.distance(m.second)));
        let Some(motion_px) = motion.filter(|_| matches.len() >= min_matches) else {
            let (found, of) = (matches.len(), tentative.len());
            return Ok(Err(format!("{found} of {of} matches agree, at least {min_matches} are needed")));
        };
        let fraction = matches.len() as f64 / tentative.len() as f64;
        if fraction < min_inlier_fraction {
            return Ok(Err(format!("only {:.0} % of {} matches agree", 100.0 * fraction, tentative.len())));
        }
        let pair = MatchedPair { first: *first, second: *second, matches };
        let declared = score_conventions(std::slice::from_ref(&pair)).first().copied();
        let declared_px = declared.filter(|s| s.convention == Convention::Declared).map(|s| s.median_px);
        let check =
            PairCheck { frames, tentative: tentative.len(), matches: pair.matches.len(), motion_px, declared_px };
        Ok(Ok((check, pair)))
    }

    /// `measured` if it can distinguish interpretations, else the reason why not.
    fn informative(&self, measured: Measured) -> Result<Measured, String> {
        let (check, pair) = &measured;
        let ((_, first), (_, second)) = (self.of(check.frames.0)?, self.of(check.frames.1)?);
        let fewer = first.points().len().min(second.points().len());
        let fraction = check.matches as f64 / fewer as f64;
        if fraction < self.options.min_feature_fraction {
            return Err(format!("only {:.1} % of {fewer} features match", 100.0 * fraction));
        }
        if check.motion_px < self.options.min_motion * pair.first.diagonal() {
            return Err(format!("points move by only {:.1} px", check.motion_px));
        }
        Ok(measured)
    }

    /// What is known of a frame that was described before.
    #[expect(clippy::expect_used, reason = "pairs are matched, and thereby described, before anything else")]
    fn of(&self, position: usize) -> Result<&(View, Features), String> {
        self.described.get(&position).expect("described before").as_ref().map_err(String::clone)
    }

    fn describe(&mut self, position: usize) -> Result<(), OpenCvError> {
        if self.described.contains_key(&position) {
            return Ok(());
        }
        let scene = self.scene;
        let described = match scene.frames.get(position) {
            Some(frame) => self.view_of(position, frame)?,
            None => Err(format!("the scene has no frame {position}: it has {}, counted from 0", scene.frames.len())),
        };
        self.described.insert(position, described);
        Ok(())
    }

    fn view_of(&mut self, position: usize, frame: &Frame) -> Result<Described, OpenCvError> {
        match (self.image_of)(position) {
            Ok(image) => {
                let size = ImageSize { width: image.width(), height: image.height() };
                Ok(Ok((View { camera: frame.camera, size }, detect(&image, &self.options.matching)?)))
            }
            Err(error) => {
                let is_there = frame.image.is_available();
                let kind = if is_there { WarningKind::UnreadableImage } else { WarningKind::MissingImage };
                let reason = format!("frame {position}: {error}");
                self.warnings.push(kind, self.scene.key.clone(), reason.clone());
                Ok(Err(reason))
            }
        }
    }
}

fn other_of(frames: (usize, usize), one: usize) -> usize {
    if frames.0 == one { frames.1 } else { frames.0 }
}

/// The matches that agree with one fundamental matrix, fitted to raw or undistorted points.
fn agreeing(
    tentative: &[PointMatch],
    first: &View,
    second: &View,
    inlier_px: f64,
) -> Result<Vec<PointMatch>, OpenCvError> {
    let mut agrees = epipolar_inliers(tentative, inlier_px)?;
    let distorted = [first, second].iter().any(|view| Convention::NoDistortion.reinterpret(view).is_some());
    if distorted {
        let undistorted = |points: &PointMatch| {
            Some(PointMatch { first: first.undistorted(points.first)?, second: second.undistorted(points.second)? })
        };
        let (positions, points): (Vec<usize>, Vec<PointMatch>) =
            (0..).zip(tentative).filter_map(|(position, points)| Some((position, undistorted(points)?))).unzip();
        for (position, kept) in positions.into_iter().zip(epipolar_inliers(&points, inlier_px)?) {
            if let Some(slot) = agrees.get_mut(position) {
                *slot |= kept;
            }
        }
    }
    Ok(tentative.iter().zip(agrees).filter_map(|(points, kept)| kept.then_some(*points)).collect())
}

impl fmt::Display for GeometryCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, pairs, skipped, scores, fit } = self;
        let matches: usize = pairs.iter().map(|pair| pair.matches).sum();
        writeln!(f, "{scene}: {matches} matches in {} pairs, {} skipped", pairs.len(), skipped.len())?;
        // Those that were asked for; of others, none was found.
        for SkippedPair { frames: (first, second), reason } in skipped {
            if let Some(second) = second {
                writeln!(f, "  {first}:{second} skipped: {reason}")?;
            }
        }
        let width = scores.iter().map(|score| score.convention.name().len()).max().unwrap_or(0);
        let smallest = scores.iter().min_by(|a, b| a.median_px.total_cmp(&b.median_px)).map(|score| score.convention);
        for ConventionScore { convention, median_px, in_front, .. } in scores {
            let mark = if smallest == Some(*convention) { "  ← smallest" } else { "" };
            writeln!(f, "  {convention:width$}  {median_px:10.3} px  {:5.1} % in front{mark}", 100.0 * in_front)?;
        }
        write!(f, "{fit}")
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
    use atsplat_scene::{Frame, FrameImage, SharedBytes};
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::linked::test_images::shifted_noise;

    /// A wall in three depths, which a camera passes: 13, 11 and 9 pixels a frame.
    fn passed(position: usize) -> ImageU8 {
        let position = i32::try_from(position).unwrap();
        let bands = [13, 11, 9].map(|step| shifted_noise(320, 80, position * step, 1000 * step));
        let samples = bands.iter().flat_map(|band| band.samples().iter().copied());
        ImageU8::new(320, 240, samples.collect()).unwrap()
    }

    #[test]
    fn pairs_that_cannot_be_measured_say_why() {
        let png = atsplat_pixels::encode_png(&passed(0)).unwrap();
        let images = [
            FrameImage::Encoded(SharedBytes::new(png)),
            FrameImage::Encoded(SharedBytes::new(b"no image".to_vec())),
            FrameImage::Missing("2.png".into()),
        ];
        let camera = Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(0.9, 1.2, 0.5, 0.5).unwrap());
        let frame = |(position, image): (usize, FrameImage)| Frame {
            name: position.to_string(),
            timestamp_micros: None,
            camera,
            stated_size: None,
            image,
        };
        let frames = images.into_iter().enumerate().map(frame).collect();
        let scene = Scene { key: "wall".to_owned(), url: None, frames };
        let pairs = PairChoice::Listed(vec![(0, 1), (2, 0), (0, 7)]);
        let options = GeometryCheckOptions { pairs, ..GeometryCheckOptions::default() };
        let limits = atsplat_pixels::DecodeLimits::default();
        let mut warnings = Warnings::new();
        let checked =
            check_geometry(&scene, |at| scene.decode_any_shape(at, &limits), &options, &mut warnings).unwrap();
        let kinds: Vec<_> = warnings.counts().collect();
        assert_eq!(kinds, [(WarningKind::MissingImage, 1), (WarningKind::UnreadableImage, 1)], "not of frame 7");
        let text = checked.to_string();
        for skipped in [
            "  0:1 skipped: frame 1: ",
            "  2:0 skipped: frame 2: ",
            "  0:7 skipped: the scene has no frame 7: it has 3, counted from 0\n",
        ] {
            assert!(text.contains(skipped), "{skipped}: {text}");
        }
    }

    /// From the last frames, the widest gap goes backwards to a frame that has paired forwards.
    #[test]
    fn no_pair_of_frames_is_measured_twice() {
        let frame = |position: usize| {
            let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-(position as f64), 0.0, 0.0)).unwrap();
            let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(0.9, 1.2, 0.5, 0.5).unwrap());
            let image = FrameImage::Encoded(SharedBytes::new(Vec::new()));
            Frame { name: position.to_string(), timestamp_micros: None, camera, stated_size: None, image }
        };
        let scene = Scene { key: "wall".to_owned(), url: None, frames: (0..16).map(frame).collect() };
        let options = GeometryCheckOptions { pairs: PairChoice::Spread(12), ..GeometryCheckOptions::default() };
        let checked = check_geometry(&scene, |at| Ok(passed(at)), &options, &mut Warnings::new()).unwrap();
        let frames: Vec<(usize, usize)> = checked.pairs.iter().map(|pair| pair.frames).collect();
        assert!(frames.len() >= 10 && frames.contains(&(0, 8)) && frames.contains(&(8, 12)), "{checked:?}");
        assert_eq!(frames.iter().collect::<BTreeSet<_>>().len(), frames.len(), "{frames:?}");
        assert!(frames.iter().all(|(earlier, later)| earlier < later), "{frames:?}");
    }
}
