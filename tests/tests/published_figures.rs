//! `eval/published` has the figures that the paper prints.

use std::fs;
use std::path::Path;

use atsplat_tests::shared_data;

/// The paper's own tables, beside the real data. They call the paper's method `Ours`; their table of budgets has a resolution in
/// place of height and width, with a footnote, and neither models nor the row of squares.
#[test]
fn every_cell_is_the_papers() {
    let Some(data) = shared_data("every_cell_is_the_papers") else { return };
    let paper = data.join("../paper");
    let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("../eval/published");
    let mut compared = 0;
    for entry in ours.read_dir().unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "csv") {
            let name = path.file_name().unwrap();
            let [published, printed] =
                [&path, &paper.join(name)].map(|path| fs::read_to_string(path).unwrap().trim_end().to_owned());
            match name.to_str() {
                Some("budget.csv") => assert_eq!(budgets(&published, true), budgets(&printed.replace('*', ""), false)),
                _ => assert_eq!(published, printed.replace("Ours", "ATSplat"), "{}", name.display()),
            }
            compared += 1;
        }
    }
    assert_eq!(compared, 15);
}

/// Each row as dataset, resolution, views, initial tokens, final tokens, Gaussians.
fn budgets(text: &str, is_ours: bool) -> Vec<Vec<String>> {
    let rows = text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let in_order = |row: Vec<String>| {
        if !is_ours {
            return row;
        }
        let size = format!("{}x{}", row[2], row[3]);
        [&row[..1], &[size], &row[4..]].concat()
    };
    rows.map(in_order).filter(|row| row[1] != "224x224").collect()
}
