//! Words of the command line into values.

use std::str::FromStr;

use anyhow::Context as _;
use atsplat_camera::ImageSize;
use atsplat_splat::RendererConstants;
use glam::DVec3;

/// Most frames that one call renders.
const MOST_FRAMES: usize = 1_000_000;
/// Longest side of a picture, of what the renderer for processors takes.
const LONGEST_SIDE: u32 = u16::MAX as u32;

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

/// `WxH` in pixels.
pub(crate) fn size(text: &str) -> Result<ImageSize, String> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=LONGEST_SIDE).contains(side));
    let sides = text.split_once(['x', '×']).and_then(|(width, height)| Some((side(width)?, side(height)?)));
    let (width, height) =
        sides.ok_or_else(|| format!("expected WIDTHxHEIGHT of 1 to {LONGEST_SIDE} pixels, found {text:?}"))?;
    Ok(ImageSize { width, height })
}

/// A number of frames.
pub(crate) fn frames(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| (1..=MOST_FRAMES).contains(count));
    count.ok_or_else(|| {
        let hint = if text.parse::<f64>().is_ok() { "" } else { "; the scene's file comes before the cameras" };
        format!("expected 1 to {MOST_FRAMES} frames, found {text:?}{hint}")
    })
}

pub(crate) fn finite(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("expected a finite number, found {text:?}"))
}

fn within(text: &str, expected: &str, holds: impl Fn(f64) -> bool) -> Result<f64, String> {
    let number = finite(text).ok().filter(|number| holds(*number));
    number.ok_or_else(|| format!("expected {expected}, found {text:?}"))
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    within(text, "a number above 0", |number| number > 0.0)
}

pub(crate) fn not_negative(text: &str) -> Result<f64, String> {
    within(text, "a number of at least 0", |number| number >= 0.0)
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

/// A preset's name, or the path of one; a path is read when the work begins.
pub(crate) fn constants_name(text: &str) -> Result<String, String> {
    if is_toml(text) || RendererConstants::named(text).is_some() {
        return Ok(text.to_owned());
    }
    let names = RendererConstants::PRESETS.join(", ");
    Err(format!("expected {names} or a path that ends in .toml, found {text:?}"))
}

/// The constants of a name or path.
pub(crate) fn constants(text: &str) -> anyhow::Result<RendererConstants> {
    if let Some(preset) = RendererConstants::named(text) {
        return Ok(preset);
    }
    let doing = || format!("reading constants from {text}");
    let file = std::fs::read_to_string(text).with_context(doing)?;
    let constants: RendererConstants = toml::from_str(&file).with_context(doing)?;
    constants.check().with_context(|| text.to_owned())?;
    Ok(constants)
}

fn is_toml(text: &str) -> bool {
    std::path::Path::new(text).extension().is_some_and(|extension| extension == "toml")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_axes() {
        assert_eq!(size("640x360"), Ok(ImageSize { width: 640, height: 360 }));
        for broken in ["640", "0x3", "3x0", "x", "1x2x3", "65536x1", "-1x4"] {
            assert!(size(broken).is_err(), "{broken:?}");
        }
        assert_eq!("-y".parse(), Ok(Axis(-DVec3::Y)));
        assert_eq!("+z".parse(), Ok(Axis(DVec3::Z)));
        assert!("up".parse::<Axis>().is_err() && "--y".parse::<Axis>().is_err());
    }

    #[test]
    fn backgrounds() {
        assert_eq!(background("white"), Ok([1.0; 3]));
        assert_eq!(background("0, 0.5,1"), Ok([0.0, 0.5, 1.0]));
        for broken in ["grey", "1,2", "0,0,2", "NaN,0,0", "0,0,0,0", ""] {
            assert!(background(broken).is_err(), "{broken:?}");
        }
    }

    #[test]
    fn numbers_within_their_range() {
        assert!(positive("0").is_err() && positive("inf").is_err() && positive("0.5").is_ok());
        assert!(elevation("-90").is_ok() && elevation("91").is_err() && elevation("NaN").is_err());
        assert!(angle("180").is_err() && angle("179").is_ok() && angle("0").is_err());
        assert!(frames("0").is_err() && frames("60").is_ok() && frames("1e3").is_err());
    }

    #[test]
    fn constants_by_name_and_from_a_file() {
        assert!(constants_name("inria").is_ok() && constants_name("brush").is_err());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        let preset = RendererConstants::named("gsplat-1.5").unwrap();
        std::fs::write(&path, toml::to_string(&preset).unwrap()).unwrap();
        let text = path.to_str().unwrap();
        assert_eq!(constants(text).unwrap(), preset);
        for broken in [
            RendererConstants { near: f64::NAN, ..preset.clone() },
            RendererConstants { far: 0.001, ..preset.clone() },
            RendererConstants { min_alpha: 0.0, ..preset.clone() },
            RendererConstants { blur: -1.0, ..preset.clone() },
            RendererConstants { max_alpha: 1.5, ..preset.clone() },
            RendererConstants { min_alpha: 0.9999, ..preset.clone() },
            RendererConstants { min_transmittance: 2.0, ..preset.clone() },
            RendererConstants { min_compensation: 1.5, ..preset },
        ] {
            std::fs::write(&path, toml::to_string(&broken).unwrap()).unwrap();
            let told = format!("{:#}", constants(text).unwrap_err());
            assert!(told.contains("mine.toml: ") && told.contains(", found "), "{told}");
        }
        assert!(constants("no/such.toml").is_err());
    }
}
