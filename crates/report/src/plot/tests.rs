//! What every plot promises, asked of the synthetic gallery: nothing is cut off, no text covers another, the same data
//! gives the same bytes, and odd data gives a picture and no panic.

use super::shape::{Drawing, Extent, Shape};
use super::*;
use crate::gallery::{gallery, odd_gallery};

fn texts(drawing: &Drawing) -> Vec<(&str, Extent)> {
    let words = drawing.shapes.iter().filter_map(|shape| match shape {
        Shape::Words(words) if !words.text.is_empty() => Some((words.text.as_str(), words.extent())),
        _ => None,
    });
    words.collect()
}

#[test]
fn every_text_is_inside_the_plot_and_covers_no_other() {
    for (name, drawing) in gallery() {
        let page = Extent::new(0.0, 0.0, f64::from(drawing.width), f64::from(drawing.height));
        let texts = texts(&drawing);
        assert!(texts.len() > 3, "{name} says nothing");
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
                Shape::Words(_) => true,
            };
            assert!(fits, "{name}: {shape:?}");
        }
    }
}

#[test]
fn the_same_data_gives_the_same_bytes() {
    for ((name, first), (_, second)) in gallery().into_iter().zip(gallery()) {
        assert_eq!(first.to_svg().unwrap(), second.to_svg().unwrap(), "{name}");
    }
    let (_, drawing) = gallery().swap_remove(0);
    assert_eq!(drawing.encode(PlotFormat::Png).unwrap(), drawing.encode(PlotFormat::Png).unwrap());
}

#[test]
fn an_svg_asks_for_fonts_that_exist_and_escapes_names() {
    for (name, drawing) in gallery() {
        let svg = drawing.to_svg().unwrap();
        assert!(!svg.contains("\"atsplat\""), "{name} asks for a font that only plotters knows");
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
fn a_png_has_two_pixels_to_a_css_pixel_and_shows_its_colours() {
    let (_, drawing) = gallery().into_iter().find(|(name, _)| *name == "frontier-gaussians").unwrap();
    let image = drawing.to_image().unwrap();
    assert_eq!((image.width(), image.height()), (2 * drawing.width, 2 * drawing.height));
    let plotters::style::RGBColor(r, g, b) = COLOURS[0];
    assert!(image.samples().chunks_exact(3).any(|pixel| pixel == [r, g, b]));
}

#[test]
fn odd_data_gives_a_picture() {
    for (name, drawing) in odd_gallery() {
        let svg = drawing.to_svg().unwrap();
        assert!(!svg.contains("NaN") && svg.ends_with("</svg>\n"), "{name}: {svg}");
    }
}
