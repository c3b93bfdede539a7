use std::fmt;

use super::report::{Inspection, SizeCount, Summary};

/// Sizes listed; the others are only counted.
const SIZES_LISTED: usize = 4;

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.counts(f)?;
        writeln!(f)?;
        self.statistics(f)?;
        self.problems(f)?;
        self.scenes(f)
    }
}

impl Inspection {
    fn counts(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scenes, images, lenses) = (&self.scenes, &self.images, &self.lenses);
        writeln!(f, "format    {}", self.format)?;
        let read = counted(&[(scenes.read, "read"), (scenes.unreadable, "not readable")]);
        let left_out = match scenes.left_out {
            0 => String::new(),
            count => format!("; {count} left out"),
        };
        writeln!(f, "scenes    {} listed: {read}{left_out}", scenes.listed)?;
        writeln!(f, "frames    {}", self.frames)?;
        let places = [
            (images.files, "in files"),
            (images.encoded, "in chunks"),
            (images.missing, "missing"),
            (images.empty, "empty"),
            (images.unposed, "without a usable pose"),
            (images.absent, "without an image"),
        ];
        writeln!(f, "images    {}", counted(&places))?;
        if images.headers_read + images.headers_unreadable > 0 {
            let headers = [
                (images.headers_read, "headers read"),
                (images.headers_unreadable, "not readable"),
                (images.cut_short, "cut short"),
            ];
            writeln!(f, "sizes     {} ({})", sizes(&self.sizes), counted(&headers))?;
        }
        if !self.stated_sizes.is_empty() {
            writeln!(f, "stated    {}", sizes(&self.stated_sizes))?;
        }
        let models = [(lenses.pinhole, "pinhole"), (lenses.opencv, "OpenCV"), (lenses.fisheye, "fisheye")];
        writeln!(f, "lenses    {}", counted(&models))
    }

    fn statistics(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (k, b) = (&self.intrinsics, &self.baselines);
        let groups: [(&str, &[(&str, &Summary)]); 3] = [
            (
                "over frames",
                &[
                    ("fx / width", &k.fx),
                    ("fy / height", &k.fy),
                    ("cx / width", &k.cx),
                    ("cy / height", &k.cy),
                    ("field of view x, °", &k.fov_x_degrees),
                    ("field of view y, °", &k.fov_y_degrees),
                ],
            ),
            ("over consecutive frames", &[("step", &b.step), ("rotation, °", &b.rotation_degrees)]),
            (
                "over scenes",
                &[
                    ("frames", &self.frames_per_scene),
                    ("median step", &b.scene_step),
                    ("median rotation, °", &b.scene_rotation_degrees),
                    ("extent", &b.extent),
                    ("path length", &b.path_length),
                ],
            ),
        ];
        for (title, rows) in groups {
            writeln!(f, "{title:<24}{:>12}{:>12}{:>12}", "min", "median", "max")?;
            for (name, summary) in rows {
                let [min, median, max] = [summary.min, summary.median, summary.max].map(number);
                write!(f, "  {name:<22}{min:>12}{median:>12}{max:>12}")?;
                if summary.non_finite > 0 {
                    write!(f, "  {} not finite", summary.non_finite)?;
                }
                writeln!(f)?;
            }
        }
        Ok(())
    }

    fn problems(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f)?;
        if self.problems.is_empty() {
            return writeln!(f, "no problems");
        }
        writeln!(f, "problems")?;
        for problem in &self.problems {
            writeln!(f, "  {:>8} {}", problem.count, problem.kind)?;
            for example in &problem.examples {
                writeln!(f, "           {example}")?;
            }
            let listed = problem.examples.len() as u64;
            if problem.count > listed {
                writeln!(f, "           and {} more", problem.count - listed)?;
            }
        }
        Ok(())
    }

    fn scenes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.per_scene.is_empty() {
            return Ok(());
        }
        let width = self.per_scene.iter().map(|scene| scene.key.chars().count()).fold(5, usize::max);
        writeln!(f)?;
        let titles = ["frames", "images", "step", "rotation, °", "extent", "path length"];
        write!(f, "{:<width$}", "scene")?;
        for title in titles {
            write!(f, "{title:>12}")?;
        }
        writeln!(f)?;
        for scene in &self.per_scene {
            write!(f, "{:<width$}{:>12}{:>12}", scene.key, scene.frames, scene.images)?;
            for value in [scene.step, scene.rotation_degrees, scene.extent, Some(scene.path_length)] {
                write!(f, "{:>12}", number(value))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

/// The parts that are not zero, or "none".
fn counted(parts: &[(u64, &str)]) -> String {
    let some: Vec<String> =
        parts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect();
    if some.is_empty() { "none".to_owned() } else { some.join(", ") }
}

fn sizes(counts: &[SizeCount]) -> String {
    let named = counts.iter().take(SIZES_LISTED).map(|count| format!("{} × {}", count.frames, count.size));
    let mut text: Vec<String> = named.collect();
    if let Some(others) = counts.get(SIZES_LISTED..).filter(|others| !others.is_empty()) {
        let frames: u64 = others.iter().map(|count| count.frames).sum();
        text.push(format!("{frames} of {} other sizes", others.len()));
    }
    if text.is_empty() { "none".to_owned() } else { text.join(", ") }
}

/// Six significant digits, or a dash.
fn number(value: Option<f64>) -> String {
    let Some(value) = value else { return "-".to_owned() };
    let magnitude = value.abs();
    if magnitude != 0.0 && !(1e-3..1e6).contains(&magnitude) {
        return format!("{value:.3e}");
    }
    let decimals = if magnitude < 10.0 {
        5
    } else if magnitude < 1000.0 {
        3
    } else {
        1
    };
    let text = format!("{value:.decimals$}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
