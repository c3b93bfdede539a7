//! Tests of all plots on synthetic data: nothing is cut off, no text covers another, equal data gives equal bytes, and
//! degenerate data does not panic.

use std::path::{Path, PathBuf};

use atsplat_files::Sha256Digest;

use super::*;
use crate::gallery::{gallery, odd_gallery};

#[test]
fn no_plot_has_a_fault() {
    for (name, drawing) in gallery() {
        assert!(drawing.texts().count() > 3, "{name} has too few texts");
        assert_eq!(drawing.faults(), [], "{name}");
    }
}

#[test]
fn neither_long_names_nor_gaps_nor_missing_data_make_a_fault() {
    for (name, drawing) in odd_gallery() {
        assert_eq!(drawing.faults(), [], "{name}");
    }
}

/// Error bars have their meaning below the plot, and a plot without any has no such line.
#[test]
fn bars_are_explained_where_they_are_drawn() {
    let says = |drawing: &Drawing, what: &str| drawing.texts().any(|text| text.contains(what));
    let with_bars = [
        "frontiers",
        "optimisation",
        "frontier-gaussians",
        "frontier-seconds",
        "overlap-curves",
        "overlap-bins",
        "extrapolation",
        "ablation",
        "k-scaling",
    ];
    let with_times = ["frontiers", "frontier-seconds"];
    for (name, drawing) in gallery() {
        assert_eq!(says(&drawing, ": 95 % intervals over scenes."), with_bars.contains(&name), "{name}");
        assert_eq!(says(&drawing, "Horizontal bars: quartiles of the time."), with_times.contains(&name), "{name}");
    }
    let (_, unmeasured) = odd_gallery().into_iter().find(|(name, _)| *name == "nothing measured").unwrap();
    assert!(!says(&unmeasured, "95 % intervals"));
}

#[test]
fn a_written_plot_is_checked_as_the_drawing_is() {
    for (name, drawing) in gallery() {
        let mut read = Drawing::of_svg(&drawing.to_svg().unwrap()).unwrap();
        assert_eq!(read.faults(), [], "{name}");
        let lines = |plot: &Drawing| {
            plot.items.iter().filter(|item| !matches!(item.shape, drawing::shape::Shape::Text(_))).count()
        };
        assert_eq!(lines(&read), lines(&drawing), "{name}");
        read.items.retain(|item| item.role != drawing::shape::Role::Title);
        assert_eq!(read.faults().len(), 1, "{name}");
    }
    let wrong = Drawing::of_svg("<svg width=\"2\" height=\"2\">\n<path d=\"M0 0\"/>\n</svg>").unwrap_err();
    assert!(wrong.contains("SVG, line 2") && wrong.contains("path"), "{wrong}");
}

fn svgs(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            svgs(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "svg") {
            found.push(path);
        }
    }
}

/// The files and the page of the committed report, or of the one in the folder `ATSPLAT_CHECKED_REPORT`.
#[test]
fn no_plot_of_the_reference_report_has_a_fault() {
    let committed = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../reports/reference");
    let folder = std::env::var_os("ATSPLAT_CHECKED_REPORT").map_or_else(committed, PathBuf::from);
    let mut files = Vec::new();
    svgs(&folder, &mut files);
    let mut plots: Vec<(String, String)> =
        files.iter().map(|path| (path.display().to_string(), std::fs::read_to_string(path).unwrap())).collect();
    let page = std::fs::read_to_string(folder.join("index.html")).unwrap();
    for part in page.split("<figure id=\"plot-").skip(1) {
        let (name, rest) = part.split_once('"').unwrap();
        let (from, to) = (rest.find("<svg ").unwrap(), rest.find("</svg>").unwrap());
        plots.push((format!("index.html, {name}"), rest[from..to].trim_end().to_owned()));
    }
    assert!(plots.len() > 10, "{} plots", plots.len());
    let faults: Vec<String> = plots
        .iter()
        .flat_map(|(name, svg)| match Drawing::of_svg(svg) {
            Ok(drawing) => drawing.faults().into_iter().map(|fault| format!("{name}: {fault}")).collect(),
            Err(error) => vec![format!("{name}: {error}")],
        })
        .collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// `reports/screenshots/make` writes the hash of the page that it photographs.
#[test]
fn the_screenshots_are_of_the_reference_report() {
    let read =
        |file: &str| std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../reports").join(file)).unwrap();
    let page = format!("{}\n", Sha256Digest::of(&read("reference/index.html")));
    assert_eq!(String::from_utf8(read("screenshots/page.sha256")).unwrap(), page, "run reports/screenshots/make");
}

#[test]
fn equal_data_gives_equal_bytes() {
    for ((name, first), (_, second)) in gallery().into_iter().zip(gallery()) {
        assert_eq!(first.to_svg().unwrap(), second.to_svg().unwrap(), "{name}");
    }
    let (_, drawing) = gallery().swap_remove(0);
    assert_eq!(drawing.encode(PlotFormat::Png).unwrap(), drawing.encode(PlotFormat::Png).unwrap());
}

#[test]
fn an_svg_uses_real_fonts_and_escapes_names() {
    for (name, drawing) in gallery() {
        let svg = drawing.to_svg().unwrap();
        assert_eq!(svg.matches("font-family").count(), 1, "{name} uses one font");
        assert!(
            svg.starts_with(&format!("<svg width=\"{}\" height=\"{}\" viewBox", drawing.width, drawing.height)),
            "{name}"
        );
    }
    let scatter = SceneScatter {
        title: "<script>alert(1)</script>".to_owned(),
        subtitle: String::new(),
        quality: atsplat_metrics::definition("psnr").unwrap().into(),
        y: "y & z".to_owned(),
        panels: vec![ScatterPanel {
            x: "\"x\"".to_owned(),
            difference: String::new(),
            points: vec![ScatterPoint { scene: "<img onerror=1>".to_owned(), x: 1.0, y: 2.0 }],
        }],
        named: 1,
    };
    let svg = scatter.draw().to_svg().unwrap();
    assert!(!svg.contains("<script") && !svg.contains("<img"), "{svg}");
}

#[test]
fn a_png_has_two_pixels_per_css_pixel_and_the_right_colours() {
    let (_, drawing) = gallery().into_iter().find(|(name, _)| *name == "frontier-gaussians").unwrap();
    let image = drawing.to_image().unwrap();
    assert_eq!((image.width(), image.height()), (2 * drawing.width, 2 * drawing.height));
    let plotters::style::RGBColor(r, g, b) = COLOURS[0];
    assert!(image.samples().chunks_exact(3).any(|pixel| pixel == [r, g, b]));
}

#[test]
fn degenerate_data_gives_a_drawing() {
    for (name, drawing) in odd_gallery() {
        let svg = drawing.to_svg().unwrap();
        assert!(!svg.contains("NaN") && svg.ends_with("</svg>\n"), "{name}: {svg}");
    }
}
