use super::*;
use crate::table::Value;

#[test]
fn every_built_in_table_has_published_numbers_and_known_presets() {
    for name in TableDefinition::names() {
        let definition = TableDefinition::named(name).unwrap();
        assert_eq!(definition.name, name, "a table has the name of its file");
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
fn the_overlap_table_has_the_bins_of_its_preset() {
    let definition = TableDefinition::named("re10k_overlap").unwrap();
    let bins = atsplat_protocol::Preset::named("re10k-overlap").unwrap().overlap_bins.unwrap();
    let bins_of_table: Vec<&str> = definition.groups.iter().filter_map(|group| group.bin.as_deref()).collect();
    let known: Vec<&str> = bins.names().iter().map(String::as_str).chain(["average"]).collect();
    assert_eq!(bins_of_table, known);
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
    let good = builtin::TABLES.iter().find(|(name, _)| *name == "extrapolation").unwrap().1;
    assert!(TableDefinition::from_toml("good", good).is_ok());
    for (from, to, expected) in [
        ("extrapolation.csv", "absent.csv", "eval/published"),
        ("\"ssim\"", "\"ssim-inria\"", "ssim-inria"),
        ("\"ATSplat\"", "\"Theirs\"", "Theirs"),
        ("{method}", "{methods}", "methods"),
        ("\"lpips\"", "\"lpisp\"", "lpisp"),
        ("others = true", "other = true", "other"),
    ] {
        let broken = good.replace(from, to);
        assert_ne!(broken, good);
        let error = TableDefinition::from_toml("broken", &broken).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    assert!(TableDefinition::named("re20k").unwrap_err().to_string().contains("re10k"));
}
