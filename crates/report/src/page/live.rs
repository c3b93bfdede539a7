//! Section of the live view: Gaussians that a reader turns, and their trial's images in a row.

use atsplat_eval::live::{LiveScene, LiveStage, LiveToken};
use atsplat_pixels::{ImageU8, encode_png};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use super::{Film, escaped};
use crate::ReportError;

/// A trial in the live view.
#[derive(Clone, Debug)]
pub struct LiveTrial {
    /// Scene and protocol.
    pub title: String,
    /// Gaussians and cameras.
    pub scene: LiveScene,
    /// Context, target, render, error, uncertainty, depth: shown in a row.
    pub images: Vec<LiveImage>,
    /// A path between its context cameras, methods side by side.
    pub film: Option<Film>,
}

/// An image of a trial.
#[derive(Clone, Debug)]
pub struct LiveImage {
    /// What it shows.
    pub title: String,
    /// Its score or range.
    pub note: String,
    /// The image.
    pub image: ImageU8,
}

/// The section, empty without trials.
pub(super) fn section(trials: &[LiveTrial]) -> Result<String, ReportError> {
    if trials.is_empty() {
        return Ok(String::new());
    }
    let options: String = trials
        .iter()
        .enumerate()
        .map(|(at, trial)| format!("<option value=\"{at}\">{}</option>", escaped(&trial.title)))
        .collect();
    let rows = trials.iter().map(row).collect::<Result<String, ReportError>>()?;
    Ok(format!(
        "<section id=\"live\" aria-labelledby=\"live-head\">\n  <h2 id=\"live-head\">Live view</h2>\n  \
         <p class=\"hint\">Drag to turn, wheel or two fingers to approach, shift and drag to move; arrow keys, + and − do the \
         same. Gaussians are stored in 16 bytes, with the constant band of their spherical harmonics alone, so colours do not \
         depend on the view.</p>\n  {}\n  {rows}</section>\n",
        include_str!("live.html").replace("{options}", &options)
    ))
}

fn row(trial: &LiveTrial) -> Result<String, ReportError> {
    let mut text = format!("<h3>{}</h3>\n<div class=\"strip\">", escaped(&trial.title));
    for LiveImage { title, note, image } in &trial.images {
        let png = encode_png(image)?;
        text.push_str(&format!(
            "<figure><img alt=\"{0}\" width=\"{1}\" height=\"{2}\" src=\"data:image/png;base64,{3}\">\
             <figcaption><b>{0}</b> {4}</figcaption></figure>",
            escaped(title),
            image.width(),
            image.height(),
            STANDARD.encode(png),
            escaped(note),
        ));
    }
    text.push_str("</div>\n");
    if let Some(film) = &trial.film {
        text.push_str(&film.player()?);
    }
    Ok(text)
}

/// The trials for the page's script.
pub(super) fn data(trials: &[LiveTrial]) -> Vec<Value> {
    let stages = |scene: &LiveScene| {
        let last = scene.stages.len().saturating_sub(1);
        scene.stages.iter().enumerate().map(|(at, live)| stage(live, at == last)).collect::<Vec<_>>()
    };
    let to_json = |LiveTrial { scene, .. }: &LiveTrial| {
        let constants = &scene.options.constants;
        json!({
            "cameras": scene.cameras,
            "focus": scene.focus,
            "uncertainty": scene.uncertainty,
            "convention": {
                "near": constants.near,
                "blur": constants.blur,
                "minAlpha": constants.min_alpha,
                "maxAlpha": constants.max_alpha,
                "margin": constants.jacobian_margin,
                "background": scene.options.background,
            },
            "stages": stages(scene),
        })
    };
    trials.iter().map(to_json).collect()
}

fn stage(stage: &LiveStage, is_last: bool) -> Value {
    let label = match stage.blocks {
        _ if is_last => "the result".to_owned(),
        0 => "before block 1".to_owned(),
        blocks => format!("after block {blocks}"),
    };
    let packed = &stage.gaussians;
    let token = |token: &LiveToken| {
        let [low, high] = token.count.to_le_bytes();
        [token.block, token.uncertainty, low, high]
    };
    let tokens: Vec<u8> = stage.tokens.iter().flat_map(token).collect();
    json!({
        "label": label,
        "all": stage.all,
        "shown": stage.gaussians.bytes.len() / atsplat_eval::live::BYTES,
        "low": packed.low,
        "high": packed.high,
        "logScales": packed.log_scales,
        "brightest": packed.brightest,
        "gaussians": STANDARD.encode(&packed.bytes),
        "tokens": STANDARD.encode(tokens),
    })
}
