use super::*;
use crate::re10k::write_trajectory;
use glam::DVec3;
use proptest::prelude::*;

const ROW: &str = "45979267 0.48 0.86 0.5 0.5 0 0 1 0 0 -0.02 0 1 0 0.009 0 0 1 -0.35";

fn parse(text: &str) -> Result<Trajectory, SceneError> {
    parse_trajectory(text.as_bytes(), Path::new("clip.txt"))
}

fn message(text: &str) -> String {
    parse(text).unwrap_err().to_string()
}

/// `ROW` with one column replaced.
fn row_with(column: usize, value: &str) -> String {
    let mut columns: Vec<&str> = ROW.split(' ').collect();
    columns[column] = value;
    columns.join(" ")
}

#[test]
fn parses_header_and_row() {
    let trajectory = parse(&format!("https://www.youtube.com/watch?v=x\n{ROW}\n")).unwrap();
    assert_eq!(trajectory.url(), Some("https://www.youtube.com/watch?v=x"));
    let row = trajectory.rows[0];
    assert_eq!(row.timestamp_micros, 45_979_267);
    assert_eq!(row.intrinsics, NormalizedIntrinsics::new(0.48, 0.86, 0.5, 0.5).unwrap());
    assert_eq!(row.camera_from_world.translation(), DVec3::new(-0.02, 0.009, -0.35));
}

#[test]
fn headers_byte_order_marks_line_ends_and_blanks_do_not_affect_rows() {
    let plain = parse(ROW).unwrap();
    assert_eq!(plain.header, None);
    for text in [
        format!("\u{feff}https://youtu.be/x\r\n{ROW}\r\n"),
        format!("# recovered\n{ROW}  \t\n\n \n"),
        format!("QShWPZxTDoE\n  {ROW}"),
        format!("\n{}\n", ROW.replace(' ', " \t ")),
    ] {
        assert_eq!(parse(&text).unwrap().rows, plain.rows, "{text:?}");
    }
    assert_eq!(parse(&format!("# recovered\n{ROW}")).unwrap().url(), None, "a comment is not a URL");
}

#[test]
fn errors_name_line_column_expected_and_found() {
    assert_eq!(
        message(&format!("https://youtu.be/x\n{ROW}\n{}", row_with(3, "half"))),
        "RE10K trajectory: line 3, column 4 (cx): expected a number, found \"half\" (clip.txt)"
    );
    assert_eq!(
        message(&row_with(0, "45.9")),
        "RE10K trajectory: line 1, column 1 (timestamp): expected whole microseconds, found \"45.9\" (clip.txt)"
    );
    assert_eq!(
        message(&format!("{ROW}\n1 2 3")),
        "RE10K trajectory: line 2: expected 19 columns, found 3: \"1 2 3\" (clip.txt)"
    );
    assert!(message(&format!("{ROW} 7")).contains("expected 19 columns, found 20"));
    assert!(message("").contains("expected at least one row"));
    assert!(message("https://youtu.be/x\n").contains("expected at least one row"));
}

#[test]
fn a_malformed_first_row_is_not_a_header() {
    for text in ["45979267", "45979267x 0.48 0.86", "0.48 0.86 0.5"] {
        assert!(message(&format!("{text}\n{ROW}")).contains("line 1"), "{text:?}");
    }
}

#[test]
fn invalid_cameras_are_errors() {
    for (column, value, expected) in [
        (1, "0", "fx: expected a positive number, found 0"),
        (2, "-0.9", "fy: expected a positive number"),
        (3, "nan", "cx: expected a finite number, found NaN"),
        (5, "inf", "column 6 (k1): expected a finite number"),
        (7, "2", "expected orthonormal rows"),
        (7, "-1", "determinant -1"),
        (10, "1e999", "pose: expected a finite number, found inf"),
    ] {
        let message = message(&row_with(column, value));
        assert!(message.contains("line 1") && message.contains(expected), "{message}");
    }
}

#[test]
fn the_error_of_a_truncated_file_names_the_line() {
    let whole = format!("{ROW}\n{ROW}");
    let cut = &whole[..whole.len() - 12];
    assert!(message(cut).contains("line 2: expected 19 columns, found 15"), "{}", message(cut));
}

/// Official files have nine decimals in every column.
#[test]
fn a_file_that_ends_inside_a_number_is_an_error() {
    let (time, numbers) = ROW.split_once(' ').unwrap();
    let numbers = numbers.split(' ').map(|number| format!("{:.9}", number.parse::<f64>().unwrap()));
    let whole = [time.to_owned()].into_iter().chain(numbers).collect::<Vec<_>>().join(" ");
    assert!(parse(&whole).is_ok());
    for length in whole.len() - 10..whole.len() {
        let cut = &whole[..length];
        let message = message(&format!("{whole}\n{cut}"));
        assert!(message.contains("line 2, column 19 (tz): ") && message.contains("is it cut off?"), "{message}");
        assert!(parse(&format!("{cut}\n")).is_ok(), "a line end after {cut}");
    }
    assert!(parse(&row_with(18, "-0.3")).is_ok(), "the other columns have different numbers of decimals");
}

#[test]
fn trajectories_are_recognised_by_their_first_lines() {
    assert!(starts_like_a_trajectory(format!("https://youtu.be/x\n{ROW}\n").as_bytes()));
    assert!(starts_like_a_trajectory(format!("\n{ROW}").as_bytes()));
    for text in ["", "{\"frames\": []}", "# a\n# b\n", "1 PINHOLE 640 360 500 500 320 180"] {
        assert!(!starts_like_a_trajectory(text.as_bytes()), "{text:?}");
    }
}

#[test]
fn headers_that_would_not_round_trip_are_not_written() {
    let rows = parse(ROW).unwrap().rows;
    for header in ["two\nlines", "12345", "", " padded"] {
        let trajectory = Trajectory { header: Some(header.to_owned()), rows: rows.clone() };
        assert!(write_trajectory(&trajectory, &mut Vec::new()).is_err(), "{header:?}");
    }
}

fn any_row() -> impl Strategy<Value = TrajectoryRow> {
    let positive = || 1e-6..1e6f64;
    (
        any::<i64>(),
        positive(),
        positive(),
        -2.0..2.0f64,
        any::<bool>(),
        -3.1..3.1f64,
        prop::array::uniform3(-1e9..1e9f64),
    )
        .prop_map(|(timestamp_micros, fx, fy, cx, nine, angle, t)| {
            let (sin, cos) = angle.sin_cos();
            let cx = if nine { (cx * 1e9).round() / 1e9 } else { cx };
            let pose = [cos, 0.0, sin, t[0], 0.0, 1.0, 0.0, t[1], -sin, 0.0, cos, t[2]];
            TrajectoryRow {
                timestamp_micros,
                intrinsics: NormalizedIntrinsics::new(fx, fy, cx, 0.5).unwrap(),
                radial: [0.0, -0.0],
                camera_from_world: CameraFromWorld::from_rows(&pose).unwrap(),
            }
        })
}

proptest! {
    #[test]
    fn written_trajectories_round_trip_bit_for_bit(
        rows in prop::collection::vec(any_row(), 1..8),
        header in prop::option::of("https://www[.]youtube[.]com/watch[?]v=[A-Za-z0-9_-]{11}"),
    ) {
        let trajectory = Trajectory { header, rows };
        let mut text = Vec::new();
        write_trajectory(&trajectory, &mut text).unwrap();
        let back = parse_trajectory(&text, Path::new("clip.txt")).unwrap();
        prop_assert_eq!(&back, &trajectory);
        let mut again = Vec::new();
        write_trajectory(&back, &mut again).unwrap();
        prop_assert_eq!(text, again);
    }

    #[test]
    fn any_bytes_give_a_value_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        parse_trajectory(&bytes, Path::new("clip.txt")).ok();
    }

    #[test]
    fn any_truncation_gives_a_value_or_an_error(cut in 0usize..300) {
        let whole = format!("https://youtu.be/x\n{ROW}\n{ROW}\n{ROW}\n");
        let cut = cut.min(whole.len());
        if let Ok(trajectory) = parse(&whole[..cut]) {
            prop_assert!(trajectory.rows.len() <= 3);
        }
    }
}
