//! What plots are drawn with: shapes and text on a [`Drawing`](shape::Drawing), axes and scales, colours, and the checks of the
//! result.

pub(super) mod axes;
pub(super) mod check;
pub(super) mod font;
pub(super) mod image_grid;
pub(super) mod labels;
pub(super) mod render;
pub(super) mod scale;
pub(super) mod series;
pub(super) mod shape;
mod sight;
pub(crate) mod svg;
#[cfg(test)]
pub(super) mod svg_reader;
pub(super) mod theme;
