use std::collections::BTreeSet;
use std::path::Path;

use atsplat_protocol::IndexFile;
use atsplat_tests::shared_data;

use super::*;
use crate::table::Value;

#[test]
fn every_built_in_table_has_published_numbers_and_known_presets() {
    for name in TableDefinition::names() {
        let definition = TableDefinition::named(name).unwrap();
        assert_eq!(definition.name, name, "a table has the name of its file");
        assert_eq!(definition.published, format!("{name}.csv"), "and so have its published numbers");
        let published = definition.published().unwrap();
        assert!(published.rows.len() > 1, "{name}");
        let numbers = published.rows.iter().flat_map(|row| row.values.iter().flatten());
        assert!(numbers.filter(|value| value.number().is_some()).count() >= published.rows.len(), "{name}");
        for preset in definition.groups.iter().filter_map(|group| group.preset.as_ref()) {
            assert!(atsplat_protocol::Preset::named(preset).is_ok(), "{name}: {preset}");
        }
        for row in &definition.rows {
            let preset = row.preset.as_ref().map(|preset| atsplat_protocol::Preset::named(preset).is_ok());
            assert_ne!(preset, Some(false), "{name}: {:?}", row.preset);
        }
        let back: TableDefinition = toml::from_str(&toml::to_string(&definition).unwrap()).unwrap();
        assert_eq!(back, definition, "{name} changes when written and read back");
    }
}

#[test]
fn every_file_of_a_table_is_built_in() {
    for (folder, ending) in [("tables", "toml"), ("published", "csv")] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval").join(folder);
        let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
        let of_tables = files.filter(|path| path.extension().is_some_and(|extension| extension == ending));
        let names: BTreeSet<String> = of_tables.map(|path| path.file_stem().unwrap().display().to_string()).collect();
        assert_eq!(names, TableDefinition::names().map(str::to_owned).collect(), "{ending}");
    }
}

#[test]
fn the_overlap_table_has_the_bins_of_its_preset() {
    let definition = TableDefinition::named("re10k_overlap").unwrap();
    let bins = atsplat_protocol::Preset::named("re10k-overlap").unwrap().overlap_bins.unwrap();
    let sets_of_table: Vec<TargetSet> = definition.groups.into_iter().map(|group| group.targets).collect();
    let of_bins = bins.names().iter().cloned().map(TargetSet::Bin);
    let expected: Vec<TargetSet> = [TargetSet::All].into_iter().chain(of_bins).chain([TargetSet::AllBins]).collect();
    assert_eq!(sets_of_table, expected);
}

/// NoPoSplat's "Average", computed from the published bins and their numbers of scenes, to 0.005 dB, for the four other
/// methods of the table.
#[test]
fn published_averages_follow_from_the_bins() {
    let published = TableDefinition::named("re10k_overlap").unwrap().published().unwrap();
    let psnr = |row: &PublishedRow, group: usize| row.values[group][0].number().unwrap();
    let half = atsplat_numeric::Tolerance::absolute(0.005);
    let mut averages = Vec::new();
    for row in published.rows.iter().take(4) {
        let bins = [(1403.0, 1), (2568.0, 2), (1630.0, 3)];
        let weighted = bins.iter().map(|(scenes, group)| scenes * psnr(row, *group)).sum::<f64>() / 5601.0;
        assert!(half.accepts(weighted, psnr(row, 4)), "{:?}: {weighted}", row.labels);
        averages.push(format!("{:.2}", psnr(row, 4)));
    }
    assert_eq!(averages, ["23.86", "24.01", "25.59", "26.70"]);
}

/// `docs/fit.md` lists how optimisation differs from the published code.
#[test]
fn tables_of_optimised_rows_say_that_their_extent_is_another() {
    let is_optimised = |row: &RowDefinition| {
        let kind = row.method.as_ref().and_then(|rule| rule.kind.as_deref());
        kind.is_some_and(|kind| ["3dgs", "mip-splatting"].contains(&kind))
    };
    let all = TableDefinition::names().map(|name| TableDefinition::named(name).unwrap());
    let optimised: Vec<TableDefinition> = all.filter(|table| table.rows.iter().any(is_optimised)).collect();
    assert!(!optimised.is_empty());
    for table in optimised {
        let says = |note: &String| note.contains("extent") && note.contains("at least half the points' median depth");
        assert!(table.notes.iter().any(says), "{}: {:?}", table.name, table.notes);
    }
}

/// The published windows that start before frame 10 are moved by what is missing.
#[test]
fn the_extrapolation_table_counts_the_windows_that_move() {
    let Some(data) = shared_data("the_extrapolation_table_counts_the_windows_that_move") else { return };
    let path = data.join("index/depthsplat/dl3dv_start_0_distance_50_ctx_6v_video_0_50.json");
    let index = IndexFile::read(&path).unwrap().index;
    let moved: Vec<usize> = index.entries().map(|(_, _, entry)| 10 - entry.window().unwrap().0.min(10)).collect();
    let [none, all] = [0, 10].map(|by| moved.iter().filter(|frames| **frames == by).count());
    let (total, fewer) = (moved.len(), moved.len() - none - all);
    let expected = format!("of the {total}, {all} are moved by 10 frames here, {fewer} by 1 to 9, {none} not at all");
    let notes = TableDefinition::named("extrapolation").unwrap().notes;
    assert!(notes.concat().contains(&expected), "{expected}: {notes:?}");
}

#[test]
fn reads_text_and_missing_values() {
    let anchors = TableDefinition::named("ablation_anchor_dl3dv").unwrap().published().unwrap();
    assert_eq!(anchors.rows[2].values[0][0], Value::Text("Diverged".to_owned()));
    let re10k = TableDefinition::named("re10k").unwrap().published().unwrap();
    assert_eq!(re10k.rows[2].values[0][4], Value::Absent, "GS-LRM's time is not published");
    let budget = TableDefinition::named("budget").unwrap().published().unwrap();
    assert_eq!(budget.rows[4].labels, ["DL3DV", "224×224", "6"]);
    assert_eq!(budget.rows[4].values[0][2], Value::Text("52K".to_owned()));
}

#[test]
fn rejects_inconsistent_definitions() {
    let good = builtin::TABLES.text("extrapolation").unwrap();
    assert!(TableDefinition::from_toml("good", good).is_ok());
    for (from, to, expected) in [
        ("extrapolation.csv", "absent.csv", "eval/published"),
        ("\"ssim\"", "\"ssim-inria\"", "ssim-inria"),
        ("\"ATSplat\"", "\"Theirs\"", "Theirs"),
        ("{method}", "{methods}", "methods"),
        ("\"lpips\"", "\"lpisp\"", "lpisp"),
        ("others = true", "other = true", "other"),
        ("variant = \"full\"", "variant = \"ful\"", "unknown variant `ful`, expected one of `full`, `ray-depth`"),
        ("kind = \"atsplat\"", "kind = \"atsplatt\"", "expected one of atsplat, atsplat+refine"),
        ("variant = \"full\"", "variant = \"full\", thresholds = [0.1]", "one of `variant` and `thresholds`"),
        ("[[groups]]", "[[groups]]\nbin = \"low\"\ndistances = [1, 9]", "one of `bin` and `distances`, found both"),
        ("[[groups]]", "[[groups]]\nbins = \"low\"", "`bins`"),
    ] {
        let broken = good.replace(from, to);
        assert_ne!(broken, good);
        let error = TableDefinition::from_toml("broken", &broken).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    assert!(TableDefinition::named("re20k").unwrap_err().to_string().contains("re10k"));
}
