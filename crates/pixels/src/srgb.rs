/// The transfer function of sRGB (IEC 61966-2-1) for values in [0, 1], in the precision of its type.
pub trait Srgb: Sized {
    /// The display-referred value of linear light.
    #[must_use]
    fn srgb_from_linear(self) -> Self;
    /// The linear light of a display-referred value.
    #[must_use]
    fn linear_from_srgb(self) -> Self;
}

macro_rules! impl_srgb {
    ($($float:ty),*) => {$(
        impl Srgb for $float {
            #[inline]
            fn srgb_from_linear(self) -> Self {
                if self <= 0.003_130_8 { 12.92 * self } else { 1.055 * self.powf(1.0 / 2.4) - 0.055 }
            }

            #[inline]
            fn linear_from_srgb(self) -> Self {
                if self <= 0.040_45 { self / 12.92 } else { ((self + 0.055) / 1.055).powf(2.4) }
            }
        }
    )*};
}

impl_srgb!(f32, f64);

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn values_are_those_of_the_standard() {
        let close = Tolerance::absolute(1e-6);
        let encoded = [0.0f64, 0.002, 0.5, 1.0].map(Srgb::srgb_from_linear);
        close.assert(encoded, [0.0, 0.025_84, 0.735_357, 1.0], "display-referred");
        let linear = [0.0f64, 0.02, 0.5, 1.0].map(Srgb::linear_from_srgb);
        close.assert(linear, [0.0, 0.001_548, 0.214_041, 1.0], "linear");
    }

    #[test]
    fn both_precisions_round_trip() {
        for step in 0..=255u8 {
            let single = f32::from(step) / 255.0;
            let round_trip = single.linear_from_srgb().srgb_from_linear();
            Tolerance::F32_ROUND_TRIP.assert([f64::from(round_trip)], [f64::from(single)], "single precision");
            let double = f64::from(step) / 255.0;
            let round_trip = double.linear_from_srgb().srgb_from_linear();
            Tolerance::absolute(1e-6).assert([round_trip], [double], "double precision");
        }
    }
}
