//! Parsers of command-line arguments.

use std::ffi::OsStr;
use std::num::FpCategory;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context as _, anyhow, bail};
use atsplat_eval::GaussianFrame;
use atsplat_files::{InvalidText, is_toml_path, malformed_toml};
use atsplat_metrics::{definition_in_any_case, definitions};
use atsplat_protocol::overlap::{FeatureOverlap, OverlapEstimator};
use atsplat_protocol::{BinRule, OverlapBins, Preset, ProtocolError, SamplingRule};
use atsplat_splat::files::Output;
use atsplat_splat::{RasterMode, RendererConstants};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Command, ValueEnum};
use glam::DVec3;

/// Maximum number of frames that one call renders.
const MAX_FRAMES: usize = 1_000_000;

/// The modes of a renderer, for [`named`].
pub(crate) const MODES: [(&str, RasterMode); 2] =
    [("classic", RasterMode::Classic), ("antialiased", RasterMode::Antialiased)];

/// A direction along one of the world's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Axis(DVec3);

impl Axis {
    pub(crate) const fn vector(self) -> DVec3 {
        self.0
    }
}

impl FromStr for Axis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (sign, letter) = text.strip_prefix('-').map_or((1.0, text.trim_start_matches('+')), |rest| (-1.0, rest));
        let axis = match letter {
            "x" => DVec3::X,
            "y" => DVec3::Y,
            "z" => DVec3::Z,
            _ => return Err(format!("expected x, y, z, -x, -y or -z, found {text:?}")),
        };
        Ok(Self(axis * sign))
    }
}

/// A number of frames.
pub(crate) fn frames(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| (1..=MAX_FRAMES).contains(count));
    count.ok_or_else(|| {
        let hint = if text.parse::<f64>().is_ok() { "" } else { "; the scene file comes before the cameras" };
        format!("expected 1 to {MAX_FRAMES} frames, found {text:?}{hint}")
    })
}

/// One line of at most 80 characters, without the spaces around it.
pub(crate) fn short_line(text: &str, expected: &str) -> Result<String, InvalidText> {
    const MAX: usize = 80;
    let line = text.trim();
    let is_short = !line.is_empty() && line.chars().count() <= MAX && !line.contains(char::is_control);
    if is_short { Ok(line.to_owned()) } else { Err(InvalidText::new(expected, text)) }
}

/// A title in tables and plots.
pub(crate) fn title(text: &str) -> Result<String, InvalidText> {
    short_line(text, "a title in one line of at most 80 characters")
}

pub(crate) fn finite(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("expected a finite number, found {text:?}"))
}

fn within(text: &str, expected: &str, is_within: impl Fn(f64) -> bool) -> Result<f64, String> {
    let number = finite(text).ok().filter(|number| is_within(*number));
    number.ok_or_else(|| format!("expected {expected}, found {text:?}"))
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    within(text, "a number above 0", |number| number > 0.0)
}

pub(crate) fn not_negative(text: &str) -> Result<f64, String> {
    within(text, "a number of at least 0", |number| number >= 0.0)
}

/// What a method takes for a trial or an image; plots of times reach from the fastest to the slowest.
pub(crate) fn stated_seconds(text: &str) -> Result<f64, String> {
    let is_plausible = |secs: f64| secs.classify() == FpCategory::Zero || (1e-9..=1e9).contains(&secs);
    within(text, "0 or 1e-9 to 1e9 seconds", is_plausible)
}

pub(crate) fn elevation(text: &str) -> Result<f64, String> {
    within(text, "-90 to 90 degrees", |number| number.abs() <= 90.0)
}

pub(crate) fn angle(text: &str) -> Result<f64, String> {
    within(text, "an angle between 0 and 180 degrees", |number| number > 0.0 && number < 180.0)
}

/// `black`, `white`, or three numbers from 0 to 1.
pub(crate) fn background(text: &str) -> Result<[f64; 3], String> {
    match text {
        "black" => return Ok([0.0; 3]),
        "white" => return Ok([1.0; 3]),
        _ => {}
    }
    let channel = |text: &str| within(text.trim(), "", |number| (0.0..=1.0).contains(&number)).ok();
    let channels: Option<Vec<f64>> = text.split(',').map(channel).collect();
    let rgb = channels.and_then(|channels| channels.try_into().ok());
    rgb.ok_or_else(|| format!("expected black, white or R,G,B from 0 to 1, found {text:?}"))
}

/// The name or path of a preset of renderer constants; help lists the names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ConstantsName;

impl TypedValueParser for ConstantsName {
    type Value = String;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<String, clap::Error> {
        constants_name.parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(RendererConstants::preset_names().map(PossibleValue::new)))
    }
}

fn constants_name(text: &str) -> Result<String, String> {
    if is_toml_path(text) || RendererConstants::named(text).is_some() {
        return Ok(text.to_owned());
    }
    let names = RendererConstants::listed_presets();
    Err(format!("expected {names} or a path that ends in .toml, found {text:?}"))
}

/// Resolves a name or path that [`ConstantsName`] accepted.
pub(crate) fn constants(text: &str) -> anyhow::Result<RendererConstants> {
    if let Some(preset) = RendererConstants::named(text) {
        return Ok(preset);
    }
    let reading = || format!("reading renderer constants from {text}");
    let file = atsplat_files::read_to_string(Path::new(text)).with_context(reading)?;
    let whole = "a table of renderer constants";
    let constants: RendererConstants = toml::from_str(&file)
        .map_err(|error| malformed_toml("renderer constants", whole, &file, &error).in_file(text))?;
    constants.check().with_context(|| text.to_owned())?;
    Ok(constants)
}

/// The id of a metric, given in upper or lower case.
pub(crate) fn metric(text: &str) -> Result<String, String> {
    if let Some(metric) = definition_in_any_case(text) {
        return Ok(metric.id.to_owned());
    }
    let ids: Vec<&str> = definitions().iter().map(|definition| definition.id).collect();
    Err(format!("expected one of {}", ids.join(", ")))
}

/// The id of a metric, or `all`.
pub(crate) fn metric_or_all(text: &str) -> Result<String, String> {
    if text.eq_ignore_ascii_case("all") { Ok("all".to_owned()) } else { metric(text) }
}

/// An existing folder.
pub(crate) fn folder(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.is_dir() { Ok(path) } else { Err(format!("expected an existing folder, found {text:?}")) }
}

/// The name or path of a protocol preset.
pub(crate) fn preset(text: &str) -> Result<String, ProtocolError> {
    name_or_path(text, Preset::resolve)
}

/// The name or path of a sampling rule.
pub(crate) fn sampler(text: &str) -> Result<String, ProtocolError> {
    name_or_path(text, SamplingRule::resolve)
}

/// Accepts paths as they are; names must resolve.
pub(crate) fn name_or_path<T, E>(text: &str, resolve: impl Fn(&str) -> Result<T, E>) -> Result<String, E> {
    if !is_toml_path(text) {
        resolve(text)?;
    }
    Ok(text.to_owned())
}

/// An estimator's name.
pub(crate) fn estimator(name: &str) -> anyhow::Result<OverlapEstimator> {
    let text = format!("estimator = {name:?}");
    let estimator: OverlapEstimator = toml::from_str(&text).map_err(|error| anyhow!("{}", error.message()))?;
    Ok(estimator.with_features(FEATURES))
}

/// The sampling rule of a name or path.
pub(crate) fn rule(sampler: &str) -> Result<SamplingRule, ProtocolError> {
    Ok(SamplingRule::resolve(sampler)?.with_features(FEATURES))
}

/// The measurement of overlap by features, in builds that have it.
#[cfg(feature = "opencv")]
const FEATURES: Option<FeatureOverlap> = Some(atsplat_opencv::feature_overlap);
#[cfg(not(feature = "opencv"))]
const FEATURES: Option<FeatureOverlap> = None;

/// `0.05,small:0.3,medium:0.55,large:0.8`: the lowest edge, below which an overlap is in no bin, then each bin's name and upper
/// edge. [`BinRule::Published`] is for the edges with which it was published.
pub(crate) fn bins(text: &str) -> anyhow::Result<OverlapBins> {
    let mut parts = text.split(',');
    let mut edges = vec![edge(parts.next().unwrap_or_default())?];
    let mut names = Vec::new();
    for part in parts {
        let Some((name, upper)) = part.split_once(':') else {
            bail!("expected NAME:UPPER, found {part:?}");
        };
        names.push(name.trim().to_owned());
        edges.push(edge(upper)?);
    }
    Ok(OverlapBins::new(BinRule::Strict, names, edges)?)
}

fn edge(text: &str) -> anyhow::Result<f64> {
    text.trim().parse().with_context(|| format!("expected a number, found {text:?}"))
}

/// One of these values by its name; help and errors list the names.
#[expect(clippy::expect_used, reason = "the parser of names accepts these alone")]
pub(crate) fn named<T: Copy + Send + Sync + 'static, const N: usize>(
    values: [(&'static str, T); N],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(values.map(|(name, _)| name)).map(move |given| {
        values.iter().find(|(name, _)| *name == given).map(|(_, value)| *value).expect("a listed name")
    })
}

/// A file of Gaussians to write, in the format that its extension names.
pub(crate) fn gaussians_file(text: &str) -> Result<PathBuf, InvalidText> {
    let path = PathBuf::from(text);
    Output::of_path(&path)?;
    Ok(path)
}

/// The world frames of Gaussians in files.
pub(crate) const GAUSSIAN_FRAMES: [(&str, GaussianFrame); 2] =
    [(GaussianFrame::Dataset.name(), GaussianFrame::Dataset), (GaussianFrame::Trial.name(), GaussianFrame::Trial)];

/// The command-line names of enum values.
pub(crate) fn names<T: ValueEnum>(values: &[T]) -> Vec<String> {
    values.iter().filter_map(T::to_possible_value).map(|value| value.get_name().to_owned()).collect()
}

/// Rejects a repeated value of a list option.
pub(crate) fn once(option: &str, values: &[String]) -> Result<(), String> {
    let is_repeated = |(at, value): &(usize, &String)| values.iter().take(*at).any(|before| before == *value);
    match values.iter().enumerate().find(is_repeated) {
        Some((_, value)) => Err(format!("{option}: {value} is given twice")),
        None => Ok(()),
    }
}

/// A usage error, which exits with code 2 as those of the argument parser do.
pub(crate) fn usage_error(message: impl std::fmt::Display) -> clap::Error {
    clap::Error::raw(clap::error::ErrorKind::ValueValidation, format!("{message}\n"))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::{CommandFactory as _, Parser as _};

    use super::*;
    use crate::Cli;

    /// The arguments that one requires, which only its debug output tells: `requires: [(IsPresent, "data")]`.
    fn required_by(arg: &Arg) -> Vec<String> {
        let text = format!("{arg:?}");
        let (_, requires) = text.split_once(" requires: [").unwrap();
        let (requires, _) = requires.split_once(']').unwrap();
        requires.split('"').skip(1).step_by(2).map(str::to_owned).collect()
    }

    /// Pairs of arguments that exclude each other; only one of them states it.
    fn conflicts(command: &Command) -> BTreeSet<[String; 2]> {
        let id = |arg: &Arg| arg.get_id().to_string();
        let stated = |arg| command.get_arg_conflicts_with(arg).into_iter().map(move |other| [id(arg), id(other)]);
        let stated = command.get_arguments().flat_map(stated);
        stated.flat_map(|[one, other]| [[one.clone(), other.clone()], [other, one]]).collect()
    }

    /// Adds the faults of a command and those below it; returns how many requirements they have.
    fn unenforced(command: &Command, faults: &mut Vec<String>) -> usize {
        let conflicts = conflicts(command);
        let mut requirements = 0;
        for arg in command.get_arguments() {
            let id = arg.get_id().as_str();
            for required in required_by(arg) {
                requirements += 1;
                for [_, other] in conflicts.iter().filter(|[one, _]| *one == required) {
                    if !conflicts.contains(&[id.to_owned(), other.clone()]) {
                        let name = command.get_name();
                        faults.push(format!("{name}: {id} requires {required}, which {other} excludes, but not {id}"));
                    }
                }
            }
        }
        requirements + command.get_subcommands().map(|below| unenforced(below, faults)).sum::<usize>()
    }

    /// clap does not enforce `requires = "a"` where an argument is given that excludes `a`: that must exclude both.
    #[test]
    fn what_excludes_a_required_argument_excludes_the_one_that_requires_it() {
        let mut command = Cli::command();
        command.build();
        let mut faults = Vec::new();
        let requirements = unenforced(&command, &mut faults);
        assert_eq!(faults, Vec::<String>::new());
        assert!(requirements > 20, "the debug output shows {requirements} requirements");
    }

    #[test]
    fn arguments_without_the_one_that_they_require_are_usage_errors() {
        let fit = "atsplat fit data --views .. --strategy 3dgs --out a.ply --seconds 1";
        let simulate = "atsplat data simulate new --frames 3";
        let reconstruct = "atsplat reconstruct data --views .. --weights random:1 --out a.ply --size 64x64";
        for (args, more) in [
            (fit, "--resume"),
            (fit, "--checkpoint-every 5"),
            (simulate, "--route-key foo"),
            (reconstruct, "--any-size"),
        ] {
            let parse = |text: &str| Cli::try_parse_from(text.split(' ')).map(drop).map_err(|error| error.exit_code());
            assert_eq!(parse(args), Ok(()), "{args}");
            assert_eq!(parse(&format!("{args} {more}")), Err(2), "{args} {more}");
        }
    }

    #[test]
    fn parses_axes() {
        assert_eq!("-y".parse(), Ok(Axis(-DVec3::Y)));
        assert_eq!("+z".parse(), Ok(Axis(DVec3::Z)));
        assert!("up".parse::<Axis>().is_err() && "--y".parse::<Axis>().is_err());
    }

    #[test]
    fn parses_backgrounds() {
        assert_eq!(background("white"), Ok([1.0; 3]));
        assert_eq!(background("0, 0.5,1"), Ok([0.0, 0.5, 1.0]));
        for broken in ["grey", "1,2", "0,0,2", "NaN,0,0", "0,0,0,0", ""] {
            assert!(background(broken).is_err(), "{broken:?}");
        }
    }

    #[test]
    fn rejects_numbers_out_of_range() {
        assert!(positive("0").is_err() && positive("inf").is_err() && positive("0.5").is_ok());
        assert!(elevation("-90").is_ok() && elevation("91").is_err() && elevation("NaN").is_err());
        assert!(angle("180").is_err() && angle("179").is_ok() && angle("0").is_err());
        assert!(frames("0").is_err() && frames("60").is_ok() && frames("1e3").is_err());
    }

    #[test]
    fn reads_constants_by_name_and_from_a_file() {
        assert!(constants_name("inria").is_ok() && constants_name("brush").is_err());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        let preset = RendererConstants::named("gsplat-1.5").unwrap();
        std::fs::write(&path, toml::to_string(&preset).unwrap()).unwrap();
        let text = path.to_str().unwrap();
        assert_eq!(constants(text).unwrap(), preset);
        let broken = RendererConstants { far: 0.001, ..preset };
        std::fs::write(&path, toml::to_string(&broken).unwrap()).unwrap();
        let message = format!("{:#}", constants(text).unwrap_err());
        assert!(message.contains("mine.toml: ") && message.contains(", found "), "{message}");
        std::fs::write(&path, "name = 'mine'\nnear = 'x'\n").unwrap();
        let message = format!("{:#}", constants(text).unwrap_err());
        assert!(message.contains("line 2 column 8: expected a number, found ") && !message.contains('\n'), "{message}");
        assert!(constants("no/such.toml").is_err());
    }

    /// In every command that takes one.
    #[test]
    fn help_lists_the_names_of_constants() {
        fn listed(command: &Command, found: &mut Vec<Vec<String>>) {
            let args = command.get_arguments().filter(|arg| arg.get_id() == "constants");
            found.extend(args.map(|arg| arg.get_possible_values().iter().map(|v| v.get_name().to_owned()).collect()));
            command.get_subcommands().for_each(|below| listed(below, found));
        }
        let mut found = Vec::new();
        listed(&Cli::command(), &mut found);
        let are_all = |names: &Vec<String>| names.iter().map(String::as_str).eq(RendererConstants::preset_names());
        assert!(found.len() >= 3 && found.iter().all(are_all), "{found:?}");
    }

    #[test]
    fn parses_overlap_bins() {
        let found = bins("0.05,small:0.3, medium:0.55,large:0.8").unwrap();
        let published = OverlapBins::noposplat(BinRule::Published);
        assert_eq!((found.names(), found.edges()), (published.names(), published.edges()));
        assert_eq!(found.estimator(), None, "the user's bins have no estimator");
        assert_eq!([0.01, 0.1].map(|overlap| found.name_of(overlap)), [None, Some("small")]);
        for broken in ["", "0.1", "0.1,a", "0.1,a:x", "0.3,a:0.1", "0.1,a:0.2,a:0.3"] {
            assert!(bins(broken).is_err(), "{broken:?}");
        }
    }

    #[test]
    fn resolves_estimators_by_name() {
        assert_eq!(estimator("epipolar-ray").unwrap().name(), "epipolar-ray");
        let error = estimator("guess").unwrap_err().to_string();
        assert!(error.contains("epipolar-ray"), "the names are listed: {error}");
    }

    #[test]
    fn checks_names_and_accepts_any_path() {
        assert!(preset("re10k-2v-256").is_ok() && sampler("re10k-2v").is_ok());
        assert!(preset("nope").is_err() && sampler("nope").is_err());
        assert!(preset("no/such.toml").is_ok() && sampler("no/such.toml").is_ok());
    }

    #[test]
    fn only_lists_of_metrics_accept_all() {
        assert_eq!((metric("psnr").as_deref(), metric_or_all("psnr").as_deref()), (Ok("psnr"), Ok("psnr")));
        assert_eq!(metric_or_all("all").as_deref(), Ok("all"));
        for unknown in [metric("all"), metric_or_all("pnsr")] {
            assert!(unknown.unwrap_err().contains("psnr, "), "the ids are listed");
        }
    }

    #[test]
    fn metrics_are_given_in_upper_or_lower_case() {
        assert_eq!(metric("PSNR").as_deref(), Ok("psnr"), "the id, not what was given");
        assert_eq!(metric_or_all("Lpips-Alex").as_deref(), Ok("lpips-alex"));
        assert_eq!(metric_or_all("ALL").as_deref(), Ok("all"));
        assert!(metric("PSNR ").is_err());
    }

    #[test]
    fn a_repeated_value_is_named() {
        let list = |values: &str| values.split(',').map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(once("--case", &list("a,b")), Ok(()));
        assert_eq!(once("--case", &list("a,b,a")), Err("--case: a is given twice".to_owned()));
    }
}
