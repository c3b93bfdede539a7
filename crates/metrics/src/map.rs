use atsplat_pixels::{Image, PixelError};
use rayon::prelude::*;

use crate::{Pair, Values};

/// One value per pixel of a part of the pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Width and height of the pictures.
    pub(crate) picture: [u32; 2],
    pub(crate) left: u32,
    pub(crate) top: u32,
    /// Width of the map.
    pub(crate) width: usize,
    pub(crate) values: Vec<f64>,
}

impl Map {
    /// Row-major values, [`Map::width`] per row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Number of values per row.
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub const fn height(&self) -> usize {
        match self.values.len().checked_div(self.width) {
            Some(rows) => rows,
            None => 0,
        }
    }

    /// Column and row of the first value in the picture.
    pub const fn origin(&self) -> [u32; 2] {
        [self.left, self.top]
    }

    /// The value at a pixel of the picture; `None` outside the map.
    pub fn at(&self, column: u32, row: u32) -> Option<f64> {
        let (column, row) = (column.checked_sub(self.left)? as usize, row.checked_sub(self.top)? as usize);
        if column < self.width { self.values.get(row * self.width + column).copied() } else { None }
    }

    /// The map as a picture in a ramp's colours, of the pictures' size. `from` has the first colour and `to` the last; values
    /// beyond them are clipped. Pixels outside the map are mid-grey.
    ///
    /// # Errors
    /// Never: there is one colour per pixel.
    pub fn to_image(&self, ramp: ColourMap, from: f64, to: f64) -> Result<Image, PixelError> {
        const OUTSIDE: [f32; 3] = [0.5; 3];
        let [width, height] = self.picture;
        let rows = (0..height).into_par_iter().flat_map_iter(move |row| {
            (0..width).flat_map(move |column| {
                self.at(column, row).map_or(OUTSIDE, |value| ramp.colour((value - from) / (to - from)))
            })
        });
        Image::new(width, height, rows.collect())
    }
}

/// Absolute difference at every pixel, averaged over channels, also outside a mask.
pub fn absolute_error_map(pair: &Pair<'_>, values: Values) -> Map {
    let [render, truth] = pair.rows(values);
    let pixels = render.as_chunks::<3>().0.iter().zip(truth.as_chunks::<3>().0);
    let values = pixels.map(|(render, truth)| {
        render.iter().zip(truth).map(|(r, t)| (f64::from(*r) - f64::from(*t)).abs()).sum::<f64>() / 3.0
    });
    Map { picture: pair.size(), left: 0, top: 0, width: pair.size()[0] as usize, values: values.collect() }
}

/// A colour map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColourMap {
    /// Black to white.
    Grey,
    /// Matplotlib's `viridis`, linearly interpolated between nine points: dark violet, green, yellow; perceptually uniform and
    /// readable with colour blindness.
    Viridis,
}

impl ColourMap {
    /// The colour at a position clipped to [0, 1]; NaN has the first colour.
    pub fn colour(self, share: f64) -> [f32; 3] {
        const VIRIDIS: [[f32; 3]; 9] = [
            [0.267, 0.005, 0.329],
            [0.279, 0.175, 0.483],
            [0.230, 0.322, 0.546],
            [0.173, 0.449, 0.558],
            [0.128, 0.567, 0.551],
            [0.158, 0.684, 0.502],
            [0.369, 0.789, 0.383],
            [0.678, 0.864, 0.190],
            [0.993, 0.906, 0.144],
        ];
        let share = if share > 0.0 { share.clamp(0.0, 1.0) } else { 0.0 };
        #[expect(clippy::cast_possible_truncation, reason = "a colour")]
        let narrow = share as f32;
        match self {
            Self::Grey => [narrow; 3],
            Self::Viridis => {
                let position = narrow * 8.0;
                let below = (1..=7u8).filter(|&point| f32::from(point) <= position).count();
                let (a, b) = (VIRIDIS[below], VIRIDIS[below + 1]);
                let part = position - below as f32;
                std::array::from_fn(|channel| a[channel] + (b[channel] - a[channel]) * part)
            }
        }
    }
}
