//! Numbers that kernels share with the host: written here, and the flags in `uniforms.rs`, alone. They precede the source of every
//! kernel.

use super::uniforms::FLAGS;

macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident: $value:literal),+ $(,)?) => {
        $($(#[$doc])* pub(super) const $name: u32 = $value;)+

        const SHARED: &[(&str, u32)] = &[$((stringify!($name), $name)),+];
    };
}

shared! {
    /// Numbers of a splat's record of gradients, from `colour_backward.wgsl` and `project_backward.wgsl`. The others are offsets in it.
    RECORD: 24,
    OF_MEAN: 0,
    OF_QUATERNION: 3,
    OF_LOG_SCALES: 7,
    OF_LOGIT: 10,
    OF_CENTRE: 11,
    OF_CONIC: 13,
    OF_ROTATION: 16,
    OF_TRANSLATION: 19,
    /// Last, because `project_backward.wgsl` begins with zeros in front of it.
    OF_SCREEN: 22,
    /// Numbers that are summed over the pixels of a pair, with one of padding.
    PAIR_SUMS: 12,
}

/// The constants in WGSL.
pub(super) fn shared_constants() -> String {
    let line = |(name, value): &(&str, u32)| ["const ", name, ": u32 = ", &value.to_string(), "u;\n"].concat();
    FLAGS.iter().chain(SHARED).map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::super::kernels::Kernel;
    use super::super::uniforms::flag;
    use super::*;

    #[test]
    fn kernels_use_every_constant_and_define_none_of_them() {
        let text = shared_constants();
        for line in
            ["const NEAR_IS_CULLED: u32 = 1u;\n", "const ABSOLUTE: u32 = 131072u;\n", "const OF_CONIC: u32 = 13u;\n"]
        {
            assert!(text.contains(line), "{line}");
        }
        let sources = Kernel::ALL.map(Kernel::source);
        for (name, _) in FLAGS.iter().chain(SHARED) {
            let separates = |letter: char| !letter.is_alphanumeric() && letter != '_';
            let uses = |source: &str| source.split(separates).any(|word| word == *name);
            assert!(sources.into_iter().any(uses), "{name} is unused");
            let definition = format!("const {name}:");
            assert!(!sources.into_iter().any(|source| source.contains(&definition)), "{name} is defined twice");
        }
    }

    #[test]
    fn flags_are_different_bits() {
        assert_eq!(FLAGS.iter().fold(0, |all, (_, flag)| all | flag), (1 << FLAGS.len()) - 1);
        assert!(FLAGS.iter().all(|(_, flag)| flag.is_power_of_two()));
        assert_eq!((flag::NEAR_IS_CULLED, flag::LENS_FISHEYE, flag::ABSOLUTE), (1, 128, 131_072));
    }

    #[test]
    fn gradients_fill_a_record_without_gaps() {
        let sizes = [3, 4, 3, 1, 2, 3, 3, 3, 2];
        let offsets = SHARED.iter().filter(|(name, _)| name.starts_with("OF_")).map(|(_, offset)| *offset);
        let mut end = 0;
        for (offset, size) in offsets.zip(sizes) {
            assert_eq!(offset, end);
            end += size;
        }
        assert_eq!(end, RECORD);
    }
}
