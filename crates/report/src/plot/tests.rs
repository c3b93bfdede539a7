//! Tests of all plots on synthetic data: nothing is cut off, no text covers another, equal data gives equal bytes, and
//! degenerate data does not panic.

use super::shape::{Drawing, Extent, Shape};
use super::*;
use crate::gallery::{gallery, odd_gallery};

fn texts(drawing: &Drawing) -> Vec<(&str, Extent)> {
    let text = drawing.shapes.iter().filter_map(|shape| match shape {
        Shape::Text(text) if !text.text.is_empty() => Some((text.text.as_str(), text.extent())),
        _ => None,
    });
    text.collect()
}

#[test]
fn every_text_is_inside_the_plot_and_covers_no_other() {
    for (name, drawing) in gallery() {
        let page = Extent::new(0.0, 0.0, f64::from(drawing.width), f64::from(drawing.height));
        let texts = texts(&drawing);
        assert!(texts.len() > 3, "{name} has too few texts");
        for (at, (text, extent)) in texts.iter().enumerate() {
            assert!(page.contains(*extent), "{name}: {text:?} is cut off: {extent:?} in {page:?}");
            for (other, place) in &texts[at + 1..] {
                assert!(extent.shared(*place) < 2.0, "{name}: {text:?} covers {other:?}");
            }
        }
    }
}

#[test]
fn every_shape_is_inside_the_plot() {
    for (name, drawing) in gallery() {
        let inside = |[x, y]: &[f64; 2]| {
            (0.0..=f64::from(drawing.width)).contains(x) && (0.0..=f64::from(drawing.height)).contains(y)
        };
        for shape in &drawing.shapes {
            let fits = match shape {
                Shape::Line { points, .. } => points.iter().all(inside),
                Shape::Area { corners, .. } => corners.iter().all(inside),
                Shape::Disc { centre, .. } | Shape::Ring { centre, .. } => inside(centre),
                Shape::Picture { at, .. } => inside(&[at.left, at.top]) && inside(&[at.right, at.bottom]),
                Shape::Text(_) => true,
            };
            assert!(fits, "{name}: {shape:?}");
        }
    }
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
        assert!(!svg.contains("\"atsplat\""), "{name} uses the internal font name");
        assert!(
            svg.starts_with(&format!("<svg width=\"{}\" height=\"{}\" viewBox", drawing.width, drawing.height)),
            "{name}"
        );
    }
    let scatter = SceneScatter {
        title: "<script>alert(1)</script>".to_owned(),
        subtitle: String::new(),
        quality: atsplat_metrics::definition("psnr").unwrap().into(),
        x: "\"x\"".to_owned(),
        y: "y & z".to_owned(),
        points: vec![ScatterPoint { scene: "<img onerror=1>".to_owned(), x: 1.0, y: 2.0 }],
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
