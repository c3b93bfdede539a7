use std::fmt::Display;

use atsplat_files::{Malformed, is_toml_path};
use atsplat_scene::preprocess::{Preprocessing, Step};

use super::{DisparityPlanes, Filters, MethodSetting, NearFar, PoseNormalisation, Preset, RendererConvention};
use crate::{IndexEntry, KnownIndex, ProtocolError, SamplingRule};

/// Checks each field of a preset, and that the fields are consistent.
pub(super) fn check(preset: &Preset) -> Result<(), ProtocolError> {
    name("name", &preset.name)?;
    name("dataset", &preset.dataset)?;
    ensure(!preset.sources.is_empty(), "sources", "at least one source", &"none")?;
    index(preset)?;
    preprocessing(&preset.preprocessing)?;
    stand_in(preset)?;
    poses("pose-normalisation", &preset.pose_normalisation, 0)?;
    planes("near-far", preset.near_far)?;
    // Methods inherit it.
    renderer("renderer", &preset.renderer)?;
    preset.methods.iter().try_for_each(|setting| method(preset, setting))?;
    filters(&preset.filters)
}

/// Checks that a preset of a file does not pass for a built-in one, under whose name it would be in tables.
pub(super) fn own_name(preset: &Preset) -> Result<(), ProtocolError> {
    let Ok(built_in) = Preset::named(&preset.name) else { return Ok(()) };
    let is_built_in = built_in.hash()? == preset.hash()? && built_in.unhashed() == preset.unhashed();
    let expected = "another name than that of a built-in protocol, from which this one differs";
    ensure(is_built_in, "name", expected, &preset.name)
}

fn preprocessing(preprocessing: &Preprocessing) -> Result<(), ProtocolError> {
    if let Some(size) = preprocessing.expected_size {
        sides("preprocessing.expected-size", size.height, size.width)?;
    }
    for (at, step) in preprocessing.steps.iter().enumerate() {
        let field = format!("preprocessing.steps[{at}]");
        match step {
            Step::RescaleAndCrop(step) => sides(&field, step.height, step.width),
            Step::CentreCrop(step) => sides(&field, step.height, step.width),
            Step::Resize(step) => sides(&field, step.height, step.width),
            Step::PatchCrop(step) => pixels(&field, "multiple", step.multiple),
            Step::SquareCrop(_) => Ok(()),
        }?;
    }
    Ok(())
}

fn sides(field: &str, height: u32, width: u32) -> Result<(), ProtocolError> {
    pixels(field, "height", height)?;
    pixels(field, "width", width)
}

fn pixels(field: &str, side: &str, found: u32) -> Result<(), ProtocolError> {
    ensure(found > 0, &format!("{field}.{side}"), "at least one pixel", &found)
}

fn method(preset: &Preset, setting: &MethodSetting) -> Result<(), ProtocolError> {
    let field = format!("methods, {}", setting.method);
    let repeated = preset.methods.iter().filter(|other| other.method.eq_ignore_ascii_case(&setting.method)).count();
    ensure(repeated == 1, &field, "every method once", &repeated)?;
    poses(&field, &setting.pose_normalisation, 0)?;
    planes(&field, setting.near_far)?;
    if let Some(DisparityPlanes { near_sides, far_pixels }) = setting.disparity_planes {
        let in_order = 0.0 < far_pixels && far_pixels < near_sides && near_sides.is_finite();
        let found = format!("{near_sides} and {far_pixels}");
        ensure(in_order, &format!("{field}, disparity-planes"), "near-sides > far-pixels > 0", &found)?;
    }
    let Some(own) = &setting.renderer else { return Ok(()) };
    // Otherwise it would be that of another rasteriser.
    let has_degree = own.rasteriser.is_none() || own.max_sh_degree.is_some();
    let field = format!("{field}, renderer");
    ensure(has_degree, &format!("{field}.max-sh-degree"), "the degree of this rasteriser", &"none")?;
    renderer(&field, &own.applied_to(&preset.renderer))
}

fn filters(filters: &Filters) -> Result<(), ProtocolError> {
    let limits = [
        ("filters.max-fov-degrees", filters.max_fov_degrees),
        ("filters.max-translation", filters.max_translation),
        ("filters.min-baseline", filters.min_baseline),
        ("filters.max-baseline", filters.max_baseline),
    ];
    for (field, limit) in limits {
        limit.map_or(Ok(()), |limit| positive(field, limit))?;
    }
    if let (Some(least), Some(most)) = (filters.min_baseline, filters.max_baseline) {
        let found = format!("{least} and {most}");
        ensure(least <= most, "filters.min-baseline and filters.max-baseline", "the smaller first", &found)?;
    }
    Ok(())
}

fn index(preset: &Preset) -> Result<(), ProtocolError> {
    let rule = &preset.index;
    let has_source = !rule.accepted.is_empty() || rule.sampler.is_some();
    ensure(has_source, "index.accepted", "at least one index, or a sampling rule", &"none")?;
    if let Some(sampler) = &rule.sampler {
        let known = SamplingRule::names().any(|name| name == sampler) || is_toml_path(sampler);
        ensure(known, "index.sampler", "a sampling rule of eval/samplers, or a path that ends in .toml", sampler)?;
    }
    ensure(rule.context_views > 0, "index.context-views", "at least one view", &rule.context_views)?;
    let (fewest, most) = rule.targets;
    let in_order = 0 < fewest && fewest <= most && most <= IndexEntry::MAX_FRAME;
    ensure(in_order, "index.targets", "fewest and most, from 1", &format!("{fewest} and {most}"))?;
    for accepted in &rule.accepted {
        let field = format!("index.accepted, {}", accepted.name);
        // A known file must have its own hash; a user's preset may name unknown files.
        let known = KnownIndex::by_name(&accepted.name);
        ensure(
            known.is_none_or(|known| known.sha256 == accepted.sha256),
            &field,
            "the sha256 of that file",
            &accepted.sha256,
        )?;
        ensure(
            known.is_none_or(|known| known.dataset == preset.dataset),
            &field,
            "an index of the preset's dataset",
            &known.map_or("", |known| known.dataset),
        )?;
    }
    Ok(())
}

/// Results of a stand-in appear in the tables of the protocol that it stands for.
fn stand_in(preset: &Preset) -> Result<(), ProtocolError> {
    let Some(name) = &preset.stands_for else { return Ok(()) };
    let expected = "a published protocol of `atsplat protocol list`";
    let known = Preset::names().any(|known| known == name);
    ensure(known, "stands-for", expected, name)?;
    let published = Preset::named(name)?;
    ensure(published.stands_for.is_none(), "stands-for", expected, &format!("{name}, which is a stand-in itself"))?;
    let (views, expected_views) = (preset.index.context_views, published.index.context_views);
    ensure(views == expected_views, "index.context-views", &format!("{expected_views}, as {name} has"), &views)
}

fn poses(field: &str, rule: &PoseNormalisation, depth: usize) -> Result<(), ProtocolError> {
    match rule {
        PoseNormalisation::None | PoseNormalisation::FirstViewRelative => Ok(()),
        PoseNormalisation::BaselineOne { minimum, maximum } | PoseNormalisation::MaxPairwise { minimum, maximum } => {
            ensure(*minimum >= 0.0 && minimum.is_finite(), field, "a minimum from 0", minimum)?;
            match maximum {
                Some(maximum) => ensure(maximum > minimum, field, "a maximum above the minimum", maximum),
                None => Ok(()),
            }
        }
        PoseNormalisation::MeanCamera { scene_scale, .. } => positive(field, *scene_scale),
        PoseNormalisation::Sequence { steps } => {
            ensure(depth == 0 && !steps.is_empty(), field, "at least one step, none of them a sequence", &steps.len())?;
            steps.iter().try_for_each(|step| poses(field, step, depth + 1))
        }
    }
}

fn planes(field: &str, NearFar { near, far }: NearFar) -> Result<(), ProtocolError> {
    let in_order = 0.0 < near && near < far && far.is_finite();
    ensure(in_order, field, "0 < near < far", &format!("{near} and {far}"))
}

/// Checks the constants of the renderer that a preset states at `place`.
fn renderer(place: &str, renderer: &RendererConvention) -> Result<(), ProtocolError> {
    let field = |name: &str| format!("{place}.{name}");
    for (name, value) in [
        ("near-cull", renderer.near_cull),
        ("alpha-max", renderer.alpha_max),
        ("alpha-min-inverse", renderer.alpha_min_inverse),
        ("transmittance-stop", renderer.transmittance_stop),
    ] {
        positive(&field(name), value)?;
    }
    ensure(renderer.alpha_max < 1.0, &field("alpha-max"), "below 1", &renderer.alpha_max)?;
    let (stop, inverse) = (renderer.transmittance_stop, renderer.alpha_min_inverse);
    #[expect(clippy::cast_possible_truncation, reason = "as renderers compare")]
    // Otherwise opaque Gaussians would never be rendered.
    let draws_opaque = 1.0 - renderer.alpha_max as f32 > stop as f32;
    ensure(draws_opaque, &field("transmittance-stop"), "a transmittance below 1 - alpha-max", &stop)?;
    let least = 1.0 / renderer.alpha_max;
    ensure(inverse > least, &field("alpha-min-inverse"), "the inverse of an alpha below alpha-max", &inverse)?;
    let dilation = renderer.dilation >= 0.0 && renderer.dilation.is_finite();
    ensure(dilation, &field("dilation"), "square pixels from 0", &renderer.dilation)?;
    let most = RendererConvention::MAX_SH_DEGREE;
    ensure(renderer.max_sh_degree <= most, &field("max-sh-degree"), &format!("0 to {most}"), &renderer.max_sh_degree)?;
    let in_range = renderer.background.iter().all(|channel| (0.0..=1.0).contains(channel));
    ensure(in_range, &field("background"), "channels from 0 to 1", &format!("{:?}", renderer.background))
}

fn name(field: &str, name: &str) -> Result<(), ProtocolError> {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let good = !name.is_empty() && name.chars().all(allowed);
    ensure(good, field, "lower-case letters, digits and hyphens", &format!("{name:?}"))
}

fn positive(field: &str, value: f64) -> Result<(), ProtocolError> {
    ensure(value > 0.0 && value.is_finite(), field, "a positive number", &value)
}

fn ensure(condition: bool, field: &str, expected: &str, found: &dyn Display) -> Result<(), ProtocolError> {
    if condition { Ok(()) } else { Err(malformed(field, expected, found)) }
}

pub(super) fn malformed(field: &str, expected: &str, found: &dyn Display) -> ProtocolError {
    Malformed::new("preset", format!("field {field}"), expected, found).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `re10k-overlap` with one piece of text replaced.
    fn changed(from: &str, to: &str) -> Result<Preset, ProtocolError> {
        let text = Preset::text_of("re10k-overlap").unwrap();
        assert!(text.contains(from), "the preset has no {from:?}");
        Preset::from_toml(&text.replacen(from, to, 1))
    }

    #[test]
    fn errors_name_the_invalid_field() {
        for (from, to, expected) in [
            ("name = \"re10k-overlap\"", "name = \"RE10K overlap\"", "field name: expected lower-case"),
            ("4940dbd5", "fbcff9b4", "field index.accepted, noposplat-re10k: expected the sha256 of that file"),
            ("targets = [3, 3]", "targets = [4, 3]", "field index.targets"),
            ("context-views = 2", "context-views = 0", "field index.context-views"),
            ("near = 0.01", "near = 1000.0", "field near-far: expected 0 < near < far"),
            ("near = 0.01", "near = nan", "field near-far"),
            ("max-fov-degrees = 100.0", "max-fov-degrees = -1.0", "field filters.max-fov-degrees"),
            ("max-baseline = 1e10", "max-baseline = 1e-4", "field filters.min-baseline and filters.max-baseline"),
            ("alpha-max = 0.99", "alpha-max = 1.0", "field renderer.alpha-max: expected below 1"),
            ("transmittance-stop = 1e-4", "transmittance-stop = 0.01", "field renderer.transmittance-stop: expected a"),
            ("alpha-min-inverse = 255.0", "alpha-min-inverse = 0.5", "field renderer.alpha-min-inverse: expected the"),
            ("background = [0.0, 0.0, 0.0]", "background = [0.0, 0.0, 2.0]", "field renderer.background"),
            ("max-sh-degree = 3", "max-sh-degree = 5", "field renderer.max-sh-degree: expected 0 to 4, found 5"),
            (
                "max-sh-degree = 4\n",
                "",
                "field methods, iLRM, renderer.max-sh-degree: expected the degree of this rasteriser, found none",
            ),
            ("dataset = \"re10k\"", "dataset = \"acid\"", "expected an index of the preset's dataset"),
            (
                "height = 256, width",
                "height = 0, width",
                "field preprocessing.steps[0].height: expected at least one pixel, found 0",
            ),
            ("width = 640", "width = 0", "field preprocessing.expected-size.width: expected at least one pixel"),
        ] {
            let error = changed(from, to).unwrap_err().to_string();
            assert!(error.starts_with("preset: field ") && error.contains(expected), "{error}");
        }
    }

    #[test]
    fn a_stand_in_has_the_views_of_a_published_protocol() {
        let changed = |from: &str, to: &str| {
            let text = Preset::text_of("rooms-2v-128").unwrap();
            assert!(text.contains(from), "the preset has no {from:?}");
            Preset::from_toml(&text.replacen(from, to, 1)).map_err(|error| error.to_string())
        };
        for (from, to, expected) in [
            ("stands-for = \"re10k-2v-256\"", "stands-for = \"re10k\"", "field stands-for: expected a published"),
            ("stands-for = \"re10k-2v-256\"", "stands-for = \"yards-6v-112\"", "which is a stand-in itself"),
            (
                "context-views = 2",
                "context-views = 3",
                "field index.context-views: expected 2, as re10k-2v-256 has, found 3",
            ),
        ] {
            let error = changed(from, to).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
        assert_eq!(changed("stands-for = \"re10k-2v-256\"", "").unwrap().stands_for, None);
    }

    #[test]
    fn every_step_has_an_output() {
        let steps = |steps: &str| {
            let text = Preset::text_of("re10k-overlap").unwrap();
            let line = text.lines().find(|line| line.starts_with("steps = ")).unwrap();
            Preset::from_toml(&text.replacen(line, &format!("steps = [{steps}]"), 1)).map_err(|error| error.to_string())
        };
        let whole = "{ step = \"square-crop\" }, { step = \"resize\", height = 64, width = 48 }";
        steps(whole).unwrap();
        for (second, field) in [
            ("{ step = \"resize\", height = 64, width = 0 }", "width"),
            ("{ step = \"centre-crop\", height = 0, width = 48 }", "height"),
            ("{ step = \"patch-crop\", multiple = 0 }", "multiple"),
        ] {
            let error = steps(&format!("{{ step = \"square-crop\" }}, {second}")).unwrap_err();
            let expected = format!("field preprocessing.steps[1].{field}: expected at least one pixel, found 0");
            assert!(error.contains(&expected), "{error}");
        }
    }

    #[test]
    fn toml_errors_name_line_and_column() {
        for (from, to, expected) in [
            ("near = 0.01", "near = \"small\"", "expected a number, found \"small\""),
            ("near = 0.01", "nearly = 0.01", "unknown field `nearly`"),
            ("context-views = 2", "context-views = -2", "line "),
            ("edges = [0.05, 0.3", "edges = [0.5, 0.3", "finite edges that increase"),
            ("step = \"rescale-and-crop\"", "step = \"rescale\"", "unknown variant `rescale`"),
            ("[index]", "[index", "line "),
            ("max-sh-degree = 3\n", "", "expected a field `max-sh-degree`, found none"),
            ("extent = \"three-sigma-tiles\"\n", "", "expected a field `extent`, found none"),
            ("extent = \"three-sigma-tiles\"", "extent = \"three-sigmas\"", "unknown variant `three-sigmas`"),
            (
                "extent = \"three-sigma-tiles\"",
                "extent = \"exact\"\nextent-sigmas = 3.0",
                "expected extent alone, found extent and extent-sigmas",
            ),
            ("max-sh-degree = 4", "max-sh-degree = 4\nextent-sigmas = 2.5", "found extent-sigmas = 2.5"),
            (
                "targets = [3, 3]",
                "targets = [3, 3]\nderivation = { rule = \"shifted-window\", margin = 0 }",
                "margin: expected 1 to 1000 frames, found 0",
            ),
        ] {
            let error = changed(from, to).unwrap_err().to_string();
            assert!(error.starts_with("preset: line ") && error.contains(expected), "{error}");
            assert!(!error.contains("line 1 column 1:"), "{error}");
        }
    }
}
