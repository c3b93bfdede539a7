use std::cmp::Ordering;
use std::collections::BTreeMap;

use crate::{Scene, WarningKind, Warnings};

/// Warns if the numbers at the end of names decrease: sorted by bytes, `10` comes before `2`.
///
/// Numbers are compared where the text before them is the same, since each camera of a rig counts separately.
pub(super) fn report_order(scene: &Scene, warnings: &mut Warnings) {
    let mut last: BTreeMap<&str, &str> = BTreeMap::new();
    let mut descents = 0usize;
    for frame in &scene.frames {
        let Some((before, number)) = numbered(&frame.name) else { continue };
        let earlier = last.insert(before, number);
        descents += usize::from(earlier.is_some_and(|earlier| compare(number, earlier) == Ordering::Less));
    }
    if descents > 0 {
        let detail = format!(
            "numbers at the end of images' names go backwards {descents} times in {} frames, which are sorted as text",
            scene.frames.len()
        );
        warnings.push(WarningKind::UnorderedTimestamps, &scene.key, detail);
    }
}

/// A name's end in digits, and what is before it. Digits behind a point may be decimals, which are in order.
fn numbered(name: &str) -> Option<(&str, &str)> {
    let before = name.trim_end_matches(|letter: char| letter.is_ascii_digit());
    let number = name.strip_prefix(before).filter(|number| !number.is_empty())?;
    (!before.ends_with('.')).then_some((before, number))
}

/// Compares numbers of any length.
fn compare(a: &str, b: &str) -> Ordering {
    let [a, b] = [a, b].map(|number| number.trim_start_matches('0'));
    a.len().cmp(&b.len()).then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ColmapOptions, ColmapScenes, SceneSource as _};

    /// What loading a model with images of these names says about their order.
    fn warned(names: &[String]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let images: Vec<String> =
            (1..).zip(names).map(|(id, name)| format!("{id} 1 0 0 0 {id} 0 0 1 {name}.png\n\n")).collect();
        std::fs::write(folder.path().join("cameras.txt"), "1 PINHOLE 200 100 100 100 100 50\n").unwrap();
        std::fs::write(folder.path().join("images.txt"), images.concat()).unwrap();
        let source = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap();
        let mut warnings = Warnings::new();
        let scene = source.load(&source.keys()[0], &mut warnings).unwrap();
        assert!(scene.frames.iter().all(|frame| frame.timestamp_micros.is_none()), "numbers of names are not times");
        let of_order = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::UnorderedTimestamps);
        of_order.map(|warning| warning.detail.clone()).collect()
    }

    #[test]
    fn numbers_without_padding_are_out_of_order() {
        for name in ["N", "frame_N", "left/IMG N"] {
            let names: Vec<String> = (0..12).map(|at| name.replace('N', &at.to_string())).collect();
            let found = warned(&names);
            let [detail] = found.as_slice() else { panic!("{name}: {found:?}") };
            assert!(detail.contains("go backwards 1 times in 12 frames"), "{detail}");
            assert!(warned(&names[..10]).is_empty(), "{name}: one digit each");
        }
    }

    #[test]
    fn padded_numbers_and_those_of_other_cameras_are_in_order() {
        for names in [
            ["frame_0009", "frame_0010", "frame_0100"],
            ["left/8", "left/9", "right/1"],
            ["a12", "b7", "c"],
            ["1305031102.1753", "1305031102.19", "1305031103.2"],
        ] {
            assert!(warned(&names.map(str::to_owned)).is_empty(), "{names:?}");
        }
    }

    #[test]
    fn numbers_of_any_length_are_compared_by_value() {
        let long = "9".repeat(40);
        let longer = format!("1{}", "0".repeat(40));
        for (a, b) in [("2", "10"), ("007", "8"), (long.as_str(), longer.as_str())] {
            assert_eq!((compare(a, b), compare(b, a)), (Ordering::Less, Ordering::Greater), "{a} {b}");
        }
        assert_eq!(compare("010", "10"), Ordering::Equal);
    }
}
