//! Every path through every hard case.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fmt::Write as _;

use atsplat_splat::hard_cases::catalogue;
use atsplat_splat::stress::{Expected, paths};

#[test]
fn every_path_survives_every_case() {
    let mut paths = paths();
    let (mut failed, mut compared) = (String::new(), 0);
    for case in catalogue() {
        let start = std::time::Instant::now();
        let expected = Expected::of(&case).unwrap();
        for path in &mut paths {
            let row = expected.row(path.as_mut());
            compared += row.error("differences").unwrap().compared;
            if std::env::var_os("SHOW").is_some() { println!("{:?} {} {}: {:?} {} {:?}", start.elapsed(), row.case, row.path, row.errors.iter().map(|e| (e.absolute, e.relative, e.compared)).collect::<Vec<_>>(), row.non_finite, row.findings); }
            if !row.passes() {
                writeln!(failed, "{row:?}").unwrap();
            }
        }
    }
    assert!(failed.is_empty(), "\n{failed}");
    assert!(compared > 1000, "{compared} derivatives compared with differences");
}
