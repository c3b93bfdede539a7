use serde::{Deserialize, Serialize};

/// Weights of a pixel's neighbourhood, the product of one row and one column of taps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Window {
    /// 11×11, a Gaussian of standard deviation 1.5 pixels, normalised.
    Gaussian11,
    /// 7×7, all alike.
    Uniform7,
}

impl Window {
    /// Pixels from the centre to the edge.
    pub const fn radius(self) -> u32 {
        match self {
            Self::Gaussian11 => 5,
            Self::Uniform7 => 3,
        }
    }

    /// Pixels in the window.
    pub const fn pixels(self) -> u32 {
        let side = 2 * self.radius() + 1;
        side * side
    }
}

/// Taps of [`Window::Gaussian11`].
pub(super) fn gaussian() -> [f64; 11] {
    let mut taps = [0.0; 11];
    for (tap, offset) in taps.iter_mut().zip(-5i8..=5) {
        *tap = (-0.5 * (f64::from(offset) / 1.5).powi(2)).exp();
    }
    let sum: f64 = taps.iter().sum();
    taps.map(|tap| tap / sum)
}

/// Taps of [`Window::Uniform7`].
pub(super) const fn uniform() -> [f64; 7] {
    [1.0 / 7.0; 7]
}
