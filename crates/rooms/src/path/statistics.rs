/// Quantiles of the motion of eleven real RE10K clips, from `data/re10k_motion.json` (made by `data/measure_motion.py`).
/// Scene units are taken as metres.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// Observed values, ascending.
    pub observed: [f64; 11],
}

impl Motion {
    /// Focal length over image height.
    pub const FY: Self = Self {
        observed: [
            0.837_305, 0.842_884, 0.842_978, 0.844_111, 0.852_039, 0.857_483, 0.860_32, 0.862_912, 0.866_272,
            0.902_491, 1.051_75,
        ],
    };
    /// Metres per second.
    pub const SPEED: Self =
        Self { observed: [0.1174, 0.2607, 0.3816, 0.383, 0.4008, 0.416, 0.4483, 0.5578, 0.6402, 0.6886, 0.7104] };
    /// Degrees per second.
    pub const TURN: Self =
        Self { observed: [1.093, 1.75, 3.057, 3.304, 5.82, 6.107, 7.959, 8.392, 11.816, 12.161, 15.243] };
    /// Distance between the ends over length of the path.
    pub const STRAIGHTNESS: Self =
        Self { observed: [0.7759, 0.7818, 0.9409, 0.9478, 0.9478, 0.9619, 0.9826, 0.9847, 0.987, 0.9899, 0.9982] };
    /// Degrees between travel and optical axis.
    pub const TRAVEL_TO_AXIS: Self =
        Self { observed: [1.82, 4.92, 9.92, 11.68, 23.36, 28.15, 33.54, 51.01, 100.81, 173.21, 178.08] };

    /// The quantile at a share in [0, 1], interpolated linearly.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index into eleven values")]
    pub fn draw(&self, share: f64) -> f64 {
        let place = share.clamp(0.0, 1.0) * 10.0;
        let at = (place.floor() as usize).clamp(0, 9);
        let (low, high) = (self.observed[at], self.observed[at + 1]);
        low + (high - low) * (place - at as f64)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn the_constants_agree_with_the_measurements() {
        let json: serde_json::Value = serde_json::from_str(include_str!("../../data/re10k_motion.json")).unwrap();
        let sorted = |field: &str| {
            let clips = json["clips"].as_array().unwrap();
            let mut values: Vec<f64> = clips.iter().map(|clip| clip[field].as_f64().unwrap()).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let fields = [
            ("fy", Motion::FY),
            ("speed", Motion::SPEED),
            ("turn-degrees-per-second", Motion::TURN),
            ("straightness", Motion::STRAIGHTNESS),
            ("travel-to-axis-degrees", Motion::TRAVEL_TO_AXIS),
        ];
        for (field, motion) in fields {
            Tolerance::EXACT.assert(motion.observed, sorted(field), field);
            Tolerance::F64.assert(
                [motion.draw(0.0), motion.draw(1.0)],
                [motion.observed[0], motion.observed[10]],
                field,
            );
            Tolerance::F64.assert([motion.draw(0.55)], [f64::midpoint(motion.observed[5], motion.observed[6])], field);
        }
    }
}
