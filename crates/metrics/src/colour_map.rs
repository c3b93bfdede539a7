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
