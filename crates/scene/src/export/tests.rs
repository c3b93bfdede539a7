use std::fs;
use std::io::Cursor;
use std::sync::atomic::{AtomicUsize, Ordering};

use arrow_array::RecordBatch;
use atsplat_tests::on_threads;
use polars::prelude::*;

use super::writer::polars_from_batch;
use super::*;
use crate::columns::schema;
use crate::columns::tests::batches_from_scene;
use crate::test_source::{TestSource, wandering_scene};
use crate::{Scene, SceneError, TimestampSource, WarningKind};

fn exported(source: &TestSource, format: ExportFormat) -> (Vec<u8>, ExportSummary, Warnings) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.table");
    let (mut warnings, steps) = (Warnings::new(), AtomicUsize::new(0));
    let step = || {
        steps.fetch_add(1, Ordering::Relaxed);
    };
    let summary = export(source, &path, format, &mut warnings, &step).unwrap();
    assert_eq!(steps.into_inner(), source.keys().len(), "one step per scene");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "only the table is left");
    let bytes = fs::read(path).unwrap();
    assert_eq!(summary.bytes, bytes.len() as u64);
    (bytes, summary, warnings)
}

fn dataset() -> TestSource {
    TestSource::new((0..40).map(|n| wandering_scene(&format!("scene {n:02}, \"quoted\""), 5 + n)))
}

/// The expected content of every file.
fn expected_frame(source: &TestSource) -> DataFrame {
    frame_of(source.scenes().flat_map(|scene| batches_from_scene(scene).unwrap()))
}

fn frame_of(batches: impl Iterator<Item = RecordBatch>) -> DataFrame {
    let frames: Vec<DataFrame> = batches.map(|batch| polars_from_batch(&batch).unwrap()).collect();
    let mut whole = frames[0].clone();
    for frame in &frames[1..] {
        whole.vstack_mut(frame).unwrap();
    }
    whole
}

/// All f64 columns as bits, for exact comparison.
fn float_bits(frame: &DataFrame) -> Vec<(String, Vec<Option<u64>>)> {
    let floats = frame.columns().iter().filter(|column| column.dtype() == &DataType::Float64);
    floats.map(|c| (c.name().to_string(), c.f64().unwrap().iter().map(|v| v.map(f64::to_bits)).collect())).collect()
}

#[test]
fn polars_reads_back_parquet() {
    let source = dataset();
    let (bytes, summary, _) = exported(&source, ExportFormat::Parquet);
    let read = ParquetReader::new(Cursor::new(bytes)).finish().unwrap();
    let expected = expected_frame(&source);
    assert!(read.equals_missing(&expected), "{read:?}");
    assert_eq!(float_bits(&read), float_bits(&expected));
    assert_eq!((summary.scenes, summary.skipped, summary.frames), (40, 0, read.height() as u64));
}

/// A capture, whose frames have numbers from the names of their images.
struct Capture(TestSource);

impl SceneSource for Capture {
    fn keys(&self) -> &[String] {
        self.0.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        self.0.load(key, warnings)
    }

    fn times(&self) -> TimestampSource {
        TimestampSource::FromNames
    }
}

#[test]
fn numbers_in_names_of_images_are_not_times() {
    let folder = tempfile::tempdir().unwrap();
    let empty_times = |source: &dyn SceneSource| {
        let path = folder.path().join("cameras.parquet");
        export(source, &path, ExportFormat::Parquet, &mut Warnings::new(), &|| ()).unwrap();
        let read = ParquetReader::new(Cursor::new(fs::read(path).unwrap())).finish().unwrap();
        (read.column("timestamp_micros").unwrap().null_count(), read.height())
    };
    let (of_video, rows) = empty_times(&dataset());
    assert_eq!((of_video, rows > 0), (0, true));
    assert_eq!(empty_times(&Capture(dataset())), (rows, rows));
}

#[test]
fn parquet_metadata_states_the_convention() {
    let (bytes, ..) = exported(&dataset(), ExportFormat::Parquet);
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.contains("atsplat.convention") && text.contains(crate::columns::CONVENTION));
}

#[test]
fn arrow_and_polars_read_back_arrow_ipc_bit_for_bit() {
    let source = dataset();
    let (bytes, ..) = exported(&source, ExportFormat::ArrowIpc);
    let reader = arrow_ipc::reader::FileReader::try_new(Cursor::new(&bytes), None).unwrap();
    assert_eq!(reader.schema(), schema(), "with its metadata");
    let expected = expected_frame(&source);
    for read in [frame_of(reader.map(Result::unwrap)), IpcReader::new(Cursor::new(&bytes)).finish().unwrap()] {
        assert!(read.equals_missing(&expected));
        assert_eq!(float_bits(&read), float_bits(&expected));
    }
}

#[test]
fn csv_floats_round_trip_bit_for_bit() {
    let source = dataset();
    let (bytes, ..) = exported(&source, ExportFormat::Csv);
    let expected = expected_frame(&source);
    let options = CsvReadOptions::default().with_schema(Some(expected.schema().clone()));
    let read = CsvReader::new(Cursor::new(&bytes)).with_options(options).finish().unwrap();
    assert_eq!(float_bits(&read), float_bits(&expected), "read by polars");

    // Also by the standard library's parser: the cells after the floats contain no commas.
    let text = String::from_utf8(bytes).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    assert_eq!(header, schema().fields().iter().map(|field| field.name().as_str()).collect::<Vec<_>>());
    let from_end = header.len() - header.iter().position(|name| *name == "r00").unwrap();
    let cell = |line: &str| line.rsplit(',').nth(from_end - 1).unwrap().parse::<f64>().unwrap().to_bits();
    let parsed: Vec<_> = text.lines().skip(1).map(|line| Some(cell(line))).collect();
    let (_, r00) = float_bits(&expected).into_iter().find(|(name, _)| name == "r00").unwrap();
    assert_eq!(parsed, r00, "read by the standard library");
}

#[test]
fn an_unreadable_scene_is_skipped_with_a_warning() {
    let source = dataset().with_unreadable("scene 07, \"quoted\"");
    let (bytes, summary, warnings) = exported(&source, ExportFormat::Parquet);
    assert_eq!((summary.scenes, summary.skipped), (39, 1));
    assert_eq!(warnings.count(WarningKind::UnreadableScene), 1);
    assert_eq!(warnings.kept()[0].scene, "scene 07, \"quoted\"");
    let read = ParquetReader::new(Cursor::new(bytes)).finish().unwrap();
    assert_eq!(read.column("scene").unwrap().n_unique().unwrap(), 39);
}

#[test]
fn an_empty_dataset_gives_an_empty_table() {
    let empty = TestSource::new([]);
    let columns = schema().fields().len();
    let parquet = ParquetReader::new(Cursor::new(exported(&empty, ExportFormat::Parquet).0)).finish().unwrap();
    assert_eq!(parquet.shape(), (0, columns));
    let ipc = IpcReader::new(Cursor::new(exported(&empty, ExportFormat::ArrowIpc).0)).finish().unwrap();
    assert_eq!(ipc.shape(), (0, columns));
    let csv = String::from_utf8(exported(&empty, ExportFormat::Csv).0).unwrap();
    assert_eq!((csv.lines().count(), csv.split(',').count()), (1, columns));
}

#[test]
fn without_a_readable_scene_the_old_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.csv");
    fs::write(&path, "old").unwrap();
    let source = TestSource::new([wandering_scene("a", 3)]).with_unreadable("a");
    let summary = export(&source, &path, ExportFormat::Csv, &mut Warnings::new(), &|| ()).unwrap();
    assert_eq!(summary, ExportSummary { skipped: 1, ..ExportSummary::default() });
    assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let source = dataset();
    for format in [ExportFormat::Parquet, ExportFormat::ArrowIpc, ExportFormat::Csv] {
        let on = |threads| on_threads(threads, || exported(&source, format).0);
        assert_eq!(on(1), on(7), "{format:?}");
    }
}

#[test]
fn an_unfinished_export_keeps_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.csv");
    fs::write(&path, "old").unwrap();
    let mut writer = TableWriter::create(&path, ExportFormat::Csv).unwrap();
    writer.write(&batches_from_scene(&wandering_scene("a", 3)).unwrap()[0]).unwrap();
    drop(writer);
    assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "the unfinished file is removed");
}

#[test]
fn unwritable_paths_fail_before_work_starts() {
    let folder = tempfile::tempdir().unwrap();
    let error = |path: &Path| TableWriter::create(path, ExportFormat::Csv).unwrap_err().to_string();
    assert!(error(folder.path()).contains("directory"), "a folder");
    assert!(error(&folder.path().join("absent/cameras.csv")).starts_with("opening an output file: "));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn formats_are_recognised_by_extension() {
    let of = |name: &str| ExportFormat::of_path(Path::new(name));
    assert_eq!(of("a/b.parquet").unwrap(), ExportFormat::Parquet);
    assert_eq!(of("b.ARROW").unwrap(), ExportFormat::ArrowIpc);
    assert_eq!(of("b.tar.csv").unwrap(), ExportFormat::Csv);
    assert_eq!(
        of("b.xlsx").unwrap_err().to_string(),
        "expected a file named .parquet, .arrow, .feather, .ipc or .csv (b.xlsx)"
    );
    assert!(of("parquet").is_err());
}
