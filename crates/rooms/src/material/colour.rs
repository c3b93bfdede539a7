use atsplat_pixels::Srgb as _;
use glam::Vec3;

use crate::rng::Rng;

/// Display-referred from linear, clipped to [0, 1].
pub(crate) fn srgb_encoded(linear: f32) -> f32 {
    linear.clamp(0.0, 1.0).srgb_from_linear()
}

/// Linear RGB of a display-referred HSV colour, hue in turns.
pub(crate) fn from_hsv(hue: f64, saturation: f64, value: f64) -> Vec3 {
    let channel = |shift: f64| {
        let k = (shift + hue.rem_euclid(1.0) * 6.0).rem_euclid(6.0);
        let share = k.clamp(0.0, 4.0 - k.clamp(3.0, 4.0)).clamp(0.0, 1.0);
        #[expect(clippy::cast_possible_truncation, reason = "a colour in [0, 1]")]
        let encoded = (value * (1.0 - saturation * share)) as f32;
        encoded.clamp(0.0, 1.0).linear_from_srgb()
    };
    Vec3::new(channel(5.0), channel(3.0), channel(1.0))
}

/// Random colours for kinds of materials.
impl Rng {
    /// Wall paint: light and weakly saturated, sometimes bold.
    pub(crate) fn paint(&mut self) -> Vec3 {
        let bold = self.chance(0.2);
        let hue = self.unit();
        if bold {
            from_hsv(hue, self.within(0.2, 0.5), self.within(0.45, 0.85))
        } else {
            from_hsv(self.within(0.05, 0.18), self.within(0.0, 0.15), self.within(0.8, 0.95))
        }
    }

    /// Light and dark grain of one wood.
    pub(crate) fn wood(&mut self) -> [Vec3; 2] {
        let (hue, saturation, value) = (self.within(0.05, 0.1), self.within(0.25, 0.6), self.within(0.35, 0.85));
        [from_hsv(hue, saturation, value), from_hsv(hue - 0.01, saturation + 0.1, value * 0.6)]
    }

    /// Two matching colours.
    pub(crate) fn pair(&mut self) -> [Vec3; 2] {
        let hue = self.unit();
        let other = hue + self.pick(0.0, &[0.08, 0.5, 0.33]);
        let (saturation, value) = (self.within(0.1, 0.8), self.within(0.3, 0.9));
        [from_hsv(hue, saturation, value), from_hsv(other, self.within(0.05, 0.6), self.within(0.2, 0.95))]
    }

    /// Light and dark colour of stone, concrete or tile, weakly saturated.
    pub(crate) fn stone(&mut self) -> [Vec3; 2] {
        let (hue, saturation, value) = (self.within(0.04, 0.15), self.within(0.0, 0.25), self.within(0.45, 0.85));
        [from_hsv(hue, saturation, value), from_hsv(hue, saturation, value * self.within(0.6, 0.85))]
    }

    /// Two greens.
    pub(crate) fn leaves(&mut self) -> [Vec3; 2] {
        let hue = self.within(0.17, 0.32);
        let (saturation, value) = (self.within(0.3, 0.55), self.within(0.4, 0.6));
        [from_hsv(hue, saturation, value), from_hsv(hue + 0.03, saturation, value * self.within(0.45, 0.6))]
    }

    /// Seed of a material.
    pub(crate) fn seed(&mut self) -> u32 {
        (self.next() >> 32) as u32
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn pure_hues_have_the_expected_rgb() {
        let close = Tolerance::absolute(1e-6);
        let check = |hue: f64, expected: [f64; 3]| {
            let found = from_hsv(hue, 1.0, 1.0).to_array().map(f64::from);
            close.assert(found, expected, "hue");
        };
        check(0.0, [1.0, 0.0, 0.0]);
        check(1.0 / 6.0, [1.0, 1.0, 0.0]);
        check(1.0 / 3.0, [0.0, 1.0, 0.0]);
        check(2.0 / 3.0, [0.0, 0.0, 1.0]);
        close.assert(from_hsv(0.3, 0.0, 1.0).to_array().map(f64::from), [1.0; 3], "white");
    }

    #[test]
    fn light_beyond_white_is_clipped() {
        let encoded = [-0.5, 0.5, 1.5].map(|linear| f64::from(srgb_encoded(linear)));
        Tolerance::absolute(1e-6).assert(encoded, [0.0, 0.735_357, 1.0], "sRGB");
    }
}
