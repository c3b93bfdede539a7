use atsplat_metrics::ColourMap;
use atsplat_pixels::ImageU8;

use super::Drawing;
use super::drawing::image_grid::{GridCell, GridRow, ImageGrid};

/// The method's error, its predicted error, and where it adds Gaussians.
#[derive(Clone, Debug)]
pub struct UncertaintyTriplets {
    /// Title.
    pub title: String,
    /// Method, protocol, what the colours mean.
    pub subtitle: String,
    /// One per view.
    pub rows: Vec<UncertaintyRow>,
}

/// One view; the maps may differ in size from the image.
#[derive(Clone, Debug)]
pub struct UncertaintyRow {
    /// Scene and frame.
    pub label: String,
    /// The render.
    pub render: ImageU8,
    /// D-SSIM against the truth, in the colours of [`ColourMap::Viridis`].
    pub error: ImageU8,
    /// The error predicted by the network, in the same colours.
    pub predicted: ImageU8,
    /// The error of the brightest colour.
    pub brightest: f64,
    /// Alpha of the Gaussians of the selected tokens, in the colours of [`ColourMap::Grey`] up to 1.
    pub selected_alpha: ImageU8,
    /// Captions of error, prediction and alpha: mean error, correlation, share selected.
    pub captions: [String; 3],
}

impl UncertaintyTriplets {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let rows = self.rows.iter().map(|row| {
            let [error, predicted, alpha] = row.captions.clone();
            let heat = Some((ColourMap::Viridis, row.brightest));
            let cells = vec![
                Some(GridCell::new(&row.render, String::new())),
                Some(GridCell { image: &row.error, caption: error, colours: heat }),
                Some(GridCell { image: &row.predicted, caption: predicted, colours: heat }),
                Some(GridCell { image: &row.selected_alpha, caption: alpha, colours: Some((ColourMap::Grey, 1.0)) }),
            ];
            GridRow { label: &row.label, cells }
        });
        let columns = ["render", "error (D-SSIM)", "predicted", "alpha of selected"].map(str::to_owned).to_vec();
        ImageGrid { title: &self.title, subtitle: &self.subtitle, columns, rows: rows.collect() }.draw()
    }
}
