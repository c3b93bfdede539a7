/// Report of writing a file: how many values a format's ranges changed by more than its usual rounding does, by kind, and
/// whether readers may reject it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExportReport {
    /// Log-scales, of three per Gaussian.
    pub log_scales: u64,
    /// SH coefficients of degree 0, of three per Gaussian.
    pub colours: u64,
    /// SH coefficients of higher degrees.
    pub coefficients: u64,
    /// Coordinates of centres, of three per Gaussian; one beyond the range of the usual steps makes all steps coarser.
    pub centres: u64,
    /// Whether the degree of the harmonics is too high for readers that know only the version written: nothing before SPZ 3 has
    /// degree 4.
    pub degree_is_unknown: bool,
}

impl ExportReport {
    /// What was clamped or rounded more coarsely than usual, and what readers may not load, in words; nothing if all is well.
    pub fn warnings(&self) -> Vec<String> {
        let kinds = [
            (self.log_scales, "log-scales", "[-10, 5.9375]"),
            (self.colours, "SH coefficients of degree 0", "±10/3"),
            (self.coefficients, "SH coefficients of higher degrees", "[-1, 1)"),
        ];
        let clamped = kinds.into_iter().filter(|(count, ..)| *count > 0);
        let clamped = clamped.map(|(count, what, range)| format!("{what} clamped to SPZ's range {range}: {count}"));
        let coarser =
            "coordinates of centres rounded more coarsely than SPZ's usual 1/4096, because one is beyond ±2047";
        let centres = (self.centres > 0).then(|| format!("{coarser}: {}", self.centres));
        let degree =
            "spherical harmonics of degree 4 in SPZ 2: programs that read no later version will not load the file";
        clamped.chain(centres).chain(self.degree_is_unknown.then(|| degree.to_owned())).collect()
    }
}
