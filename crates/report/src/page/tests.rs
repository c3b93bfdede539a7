//! Tests of the page as text.

use std::path::Path;

use atsplat_pixels::{ImageU8, encode_png};
use atsplat_results::store::images::image_path;
use atsplat_results::{MethodRecord, Results, Shard, StatedCost, StatedSeconds, TrainingRecord};

use super::*;
use crate::definition::{Choice, Quantity, TableDefinition};
use crate::plot_data::{store_plots, table_plots};
use crate::sample::{HOSTILE, atsplat, nearest_view, preset, random, results, results_over, store};
use crate::table::{CellIndex, Mixing, Row, protocol_tables, tables};

/// Owns the contents of a page.
pub(super) struct Sample {
    pub(super) results: Results,
    pub(super) folder: tempfile::TempDir,
    pub(super) tables: Vec<Table>,
    pub(super) plots: Vec<(String, Drawing)>,
}

impl Sample {
    pub(super) fn new() -> Self {
        let mut results = store();
        results.provenance.command.push(HOSTILE.to_owned());
        results.provenance.methods[1].untrained = true;
        let folder = tempfile::tempdir().unwrap();
        for row in results.targets.iter().filter(|row| !row.scores.is_empty()) {
            let position = results.provenance.methods.iter().position(|method| method.name == row.key.method).unwrap();
            for (method, offset) in [(TRUTH, 0), (row.key.method.as_str(), u32::try_from(position).unwrap() + 1)] {
                let key = row.key.of_method(method);
                let scene = row.key.preset.bytes().chain(row.key.scene.bytes()).map(u32::from).sum();
                write_image(&image_path(folder.path(), &key, row.frame), row.target + offset, scene);
            }
        }
        let source = Source { label: LABEL, results: &results };
        let (mut all, mut plots) = (Vec::new(), Vec::new());
        for name in TableDefinition::names() {
            let definition = TableDefinition::named(name).unwrap();
            for table in tables(&definition, &[source], Mixing::Apart).unwrap() {
                plots.extend(table_plots(&definition, &table, &[source]));
                all.extend(table.is_measured().then_some(table));
            }
        }
        plots.extend(store_plots(&source).unwrap());
        Self { tables: all, plots, results, folder }
    }

    pub(super) fn write(&self, max_bytes: usize, extra: Option<&str>) -> String {
        self.write_with_sections(max_bytes, extra, &[])
    }

    fn write_with_sections(&self, max_bytes: usize, extra: Option<&str>, sections: &[PlotSection]) -> String {
        let source = Source { label: LABEL, results: &self.results };
        let stores = [PageStore { source, folder: Some(self.folder.path()) }];
        let page = Page {
            title: format!("Report {HOSTILE}"),
            tables: &self.tables,
            plots: &self.plots,
            sections,
            live: &[],
            stores: &stores,
            max_bytes,
        };
        page.write_with(extra).unwrap()
    }
}

/// The first cell of a row.
const FIRST: CellIndex = CellIndex { group: 0, column: 0 };
const TRUTH: &str = "truth";
pub(super) const LABEL: &str = "run <b>1</b>";

pub(super) fn write_image(path: &Path, seed: u32, scene: u32) {
    // Consecutive seeds differ by five levels everywhere, so that an error map is not saturated.
    let sample = |at: u32| u8::try_from((at * 37 + at * at % 251 + at * scene % 53) % 200 + seed * 5).unwrap();
    let image = ImageU8::new(16, 16, (0..768).map(sample).collect()).unwrap();
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, encode_png(&image).unwrap()).unwrap();
}

#[test]
fn data_is_escaped() {
    let page = Sample::new().write(usize::MAX, None);
    assert_eq!(page.matches("<script").count(), 2, "the data and the page's script");
    assert_eq!(page.matches("</script").count(), 2);
    assert!(!page.contains("<b>1</b>") && page.contains("run &lt;b&gt;1&lt;/b&gt;"));
    let (_, data) = page.split_once("id=\"data\">").unwrap();
    let (data, _) = data.split_once("</script>").unwrap();
    let data: Value = serde_json::from_str(data).unwrap();
    let scenes: Vec<&str> =
        data["runs"][0]["trials"].as_array().unwrap().iter().map(|trial| trial["scene"].as_str().unwrap()).collect();
    assert!(scenes.contains(&HOSTILE), "the data is unchanged: {scenes:?}");
    for key in data.as_object().unwrap().keys() {
        let read = [format!("data.{key}"), format!("{{ {key}: ")];
        let is_read = [SCRIPT].iter().chain(&LIVE).any(|script| read.iter().any(|text| script.contains(text)));
        assert!(is_read, "no script reads {key}");
    }
}

/// The machine of the sections' stores.
const PROCESSOR: &str = "a processor of its own";

#[test]
fn a_leading_section_comes_before_the_tables_and_others_after_the_plots() {
    let sample = Sample::new();
    let section = |title: &str, before_tables| PlotSection {
        title: title.to_owned(),
        hint: "A hint.".to_owned(),
        plots: vec![(format!("plot of {title}"), sample.plots[0].1.clone())],
        before_tables,
        stores: vec![(
            format!("store of {title}"),
            Provenance { processor: PROCESSOR.to_owned(), ..Provenance::default() },
        )],
    };
    let page = sample.write_with_sections(usize::MAX, None, &[section("Afterwards", false), section("At first", true)]);
    let at = |what: &str| page.find(what).unwrap_or_else(|| panic!("{what}"));
    // Under "Provenance", with the machine that each was measured on.
    for title in ["Afterwards", "At first"] {
        let card = &page[at(&format!("<h3>store of {title}</h3>"))..];
        assert!(card.split("</article>").next().unwrap().contains(PROCESSOR), "{title}");
    }
    let order = ["section-1-head\">At first", "id=\"tables-head\"", "id=\"plots-head\"", "section-0-head\">Afterwards"];
    assert!(order.map(at).is_sorted(), "{:?}", order.map(at));
    let links = ["href=\"#section-1\"", "href=\"#tables\"", "href=\"#section-0\"", "href=\"#scenes\""];
    let navigation = &page[at("<nav ")..];
    let link_at = |what: &str| navigation.find(what).unwrap_or_else(|| panic!("{what}"));
    assert!(links.map(link_at).is_sorted(), "{:?}", links.map(link_at));
}

#[test]
fn the_page_loads_no_other_resources() {
    let page = Sample::new().write(usize::MAX, None);
    assert!(page.contains("default-src 'none'") && page.contains(&hash_of(SCRIPT)));
    for part in page.split(['<', ';']) {
        for loading in ["src=\"", "href=\"", "url(", "@import"] {
            if let Some((_, target)) = part.split_once(loading) {
                assert!(
                    target.starts_with('#') || target.starts_with("data:"),
                    "{loading}{}",
                    &target[..target.len().min(60)]
                );
            }
        }
    }
}

/// Two protocols of one store stand in for the same one: a number cites the one that it was measured under, which links to its table.
#[test]
fn numbers_and_links_are_of_their_own_protocol() {
    let presets = vec![preset("rooms-2v-128"), preset("rooms-2v-64")];
    let results = results(presets, vec![atsplat("atsplat", |_| ()), nearest_view()]);
    let stores = [PageStore { source: Source { label: LABEL, results: &results }, folder: None }];
    let tables = tables(&TableDefinition::named("re10k").unwrap(), &[stores[0].source], Mixing::Apart).unwrap();
    assert_eq!(tables.len(), 2);
    let protocols = [["rooms-2v-128", "rooms-2v-64"], ["rooms-2v-64", "rooms-2v-128"]];
    for (table, [cited, other]) in tables.iter().zip(protocols) {
        let row = table.rows.iter().find(|row| row.method.as_deref() == Some("atsplat")).unwrap();
        let citation = cite::citation(table, row, FIRST, &stores).unwrap();
        assert!(citation.contains(&format!("protocol {cited}@")) && !citation.contains(other), "{citation}");
    }
    let links = protocols::write(&tables, &stores);
    let of_second = links.split("<li").find(|item| item.contains("<b>rooms-2v-64</b>")).unwrap();
    assert!(of_second.contains("#table-re10k-2\"") && !of_second.contains("#table-re10k-1\""), "{links}");
}

/// Notes below the table of the first begin with the name of the method.
#[test]
fn a_method_that_is_called_like_a_protocol_is_none() {
    let method = MethodRecord { title: "rooms-2v-64".to_owned(), ..nearest_view() };
    let results = results(vec![preset("rooms-2v-128"), preset("rooms-2v-64")], vec![method]);
    let stores = [PageStore { source: Source { label: LABEL, results: &results }, folder: None }];
    let tables = tables(&TableDefinition::named("re10k").unwrap(), &[stores[0].source], Mixing::Apart).unwrap();
    assert!(tables[0].footer.iter().any(|note| note.text.starts_with("rooms-2v-64: ")), "{:?}", tables[0].footer);
    let links = protocols::write(&tables, &stores);
    let of = |name: &str| links.split("<li").find(|item| item.contains(&format!("<b>{name}</b>"))).unwrap();
    let [first, second] = ["rooms-2v-128", "rooms-2v-64"].map(of);
    assert!(first.contains("#table-re10k-1\"") && !first.contains("#table-re10k-2\""), "{links}");
    assert!(second.contains("#table-re10k-2\"") && !second.contains("#table-re10k-1\""), "{links}");
}

/// The interval is printed in the cell too, and the names are longer than a shortened hash.
#[test]
fn a_citation_has_its_interval_once_and_whole_names() {
    let (constants, backend) = (Some(MethodRecord::OF_PRESET.to_owned()), Some("on a card of a long name".to_owned()));
    let method = MethodRecord { constants, backend, ..atsplat("atsplat", |_| ()) };
    let results = results_over(vec![preset("rooms-2v-128")], vec![method], 7);
    let store = PageStore { source: Source { label: LABEL, results: &results }, folder: None };
    let tables = protocol_tables(&[store.source], Mixing::Apart).unwrap();
    let row = tables[0].rows.iter().find(|row| !row.without_leaked).unwrap();
    let citation = cite::citation(&tables[0], row, FIRST, &[store]).unwrap();
    assert!(citation.starts_with("PSNR 21.25 [95 % "), "{citation}");
    assert!(citation.contains("] over 7 scenes, 21 targets;"), "{citation}");
    assert!(citation.contains(", constants of the preset, backend on a card of a long name;"), "{citation}");
}

/// A row whose groups of columns have different methods.
#[test]
fn a_citation_names_the_method_of_its_column() {
    let trained = |name: &str, weights: &str, data: &str| MethodRecord {
        title: name.to_owned(),
        weights_sha256: Some(weights.repeat(16)),
        training: Some(TrainingRecord { data: data.to_owned(), seed: None }),
        ..atsplat(name, |_| ())
    };
    let joint = trained("joint", "1234", "rooms train 0 to 9, yards train 0 to 9");
    let results = results(vec![preset("rooms-2v-128")], vec![trained("apart", "abcd", "simulated yards"), joint]);
    let store = PageStore { source: Source { label: LABEL, results: &results }, folder: None };
    let tables = tables(&TableDefinition::named("unified").unwrap(), &[store.source], Mixing::Apart).unwrap();
    let row = tables[0].rows.iter().find(|row| row.measured_on.is_some()).unwrap();
    // Only one of them was not trained on the data of both.
    let expected = [
        ("method apart, zero-shot: not trained on rooms, weights abcdabcdabcd,", "joint"),
        ("method joint, weights 123412341234,", "apart"),
    ];
    for (group, (named, other)) in expected.into_iter().enumerate() {
        let citation = cite::citation(&tables[0], row, CellIndex { group, column: 0 }, &[store]).unwrap();
        assert!(citation.contains(named) && !citation.contains(other), "{citation}");
    }
}

/// The second method fails in a scene, was not trained on rooms, and has the weights of the first.
#[test]
fn a_citation_has_the_caveats_of_its_row() {
    let training = Some(TrainingRecord { data: "simulated yards".to_owned(), seed: None });
    let mut changed = MethodRecord { training: training.clone(), ..random() };
    changed.record_threshold_quantiles(&[0.8, 0.8, 0.9], &[0.1, 0.1, 0.4]);
    let methods = vec![MethodRecord { training, ..atsplat("atsplat", |_| ()) }, changed];
    let mut results = results_over(vec![preset("rooms-2v-128")], methods, 7);
    results.provenance.shard = Some(Shard { number: 2, count: 3 });
    results.provenance.presets[0].hash = "another".to_owned();
    let store = PageStore { source: Source { label: LABEL, results: &results }, folder: None };
    let table = protocol_tables(&[store.source], Mixing::Apart).unwrap().swap_remove(0);
    let rows: Vec<&Row> = table.rows.iter().filter(|row| row.method.as_deref() == Some("atsplat-random")).collect();
    assert_eq!(rows.len(), 2, "with and without leaked targets");
    for row in rows {
        let psnr = cite::citation(&table, row, FIRST, &[store]).unwrap();
        let targets = if row.without_leaked { 17 } else { 18 };
        let over = [format!(" over 6 scenes, {targets} targets, 3 failed and not in the mean")];
        let common = [
            ", zero-shot: not trained on rooms",
            ", thresholds by quantile",
            ", changed at inference only",
            "@another (changed), ",
        ];
        let part = " entries (shard 2 of 3 of the run), data ";
        for expected in over.iter().chain(&row.remarks).map(String::as_str).chain(common).chain([part]) {
            assert_eq!(psnr.matches(expected).count(), 1, "{expected}: {psnr}");
        }
        let size = table.columns().find(|(_, column)| column.quantity == Quantity::Gaussians).unwrap().0;
        let size = cite::citation(&table, row, size, &[store]).unwrap();
        assert!(size.contains(", without trials that failed or are not applicable"), "{size}");
    }
}

/// A process, timed on another machine than its scores are of, while others used it.
#[test]
fn a_citation_of_a_time_has_its_machine_and_words_for_its_marks() {
    let mut results = results_over(vec![preset("rooms-2v-128")], vec![atsplat("atsplat", |_| ())], 7);
    results.provenance.methods[0].kind = "exec".to_owned();
    for row in &mut results.timings {
        row.machine.processor = "the timed processor".to_owned();
        row.load.others = Some(0.4);
    }
    let store = PageStore { source: Source { label: LABEL, results: &results }, folder: None };
    let table = protocol_tables(&[store.source], Mixing::Apart).unwrap().swap_remove(0);
    let row = table.rows.iter().find(|row| !row.without_leaked).unwrap();
    let (index, column) = table.columns().find(|(_, column)| column.quantity == Quantity::Seconds).unwrap();
    assert_eq!(row.cell(index).print(column), "0.260 ‡ §");
    let time = cite::citation(&table, row, index, &[store]).unwrap();
    for expected in [
        "Time (s) 0.260, median averaged over 3 trials with 5 repetitions each, quartiles 0.25",
        ", the whole answer, with reading and writing of files, unreliable: other work or a quota took 40 % of the \
         processors; method ATSplat",
        ", the timed processor, 2 threads on 2 logical processors",
    ] {
        assert!(time.contains(expected), "{expected}: {time}");
    }
    assert!(!time.contains(['‡', '§']) && !time.contains("a processor"), "{time}");
    let score = cite::citation(&table, row, FIRST, &[store]).unwrap();
    assert!(score.ends_with(", a processor, 2 threads"), "{score}");
}

/// Nothing here has repeated it.
#[test]
fn a_citation_of_a_stated_time_claims_no_repetitions() {
    let mut imported = nearest_view();
    let seconds = Some(StatedSeconds { encode: 0.25, render: Some(0.5), machine: "a card".to_owned() });
    imported.stated.insert("rooms-2v-128".to_owned(), StatedCost { gaussians: None, seconds });
    let mut results = results_over(vec![preset("rooms-2v-128")], vec![imported], 7);
    results.timings.clear();
    let store = PageStore { source: Source { label: LABEL, results: &results }, folder: None };
    let table = protocol_tables(&[store.source], Mixing::Apart).unwrap().swap_remove(0);
    let row = table.rows.iter().find(|row| !row.without_leaked).unwrap();
    let (index, _) = table.columns().find(|(_, column)| column.quantity == Quantity::Seconds).unwrap();
    let time = cite::citation(&table, row, index, &[store]).unwrap();
    assert!(time.starts_with("Time (s) 0.250, as stated; method "), "{time}");
    assert!(time.ends_with(", a card (stated, not measured here)"), "{time}");
}

/// Nobody could count the Gaussians behind images.
#[test]
fn a_citation_of_stated_gaussians_says_so() {
    let mut imported = nearest_view();
    imported.stated.insert("rooms-2v-128".to_owned(), StatedCost { gaussians: Some(52_000), seconds: None });
    let results = results_over(vec![preset("rooms-2v-128")], vec![atsplat("atsplat", |_| ()), imported], 7);
    let store = PageStore { source: Source { label: LABEL, results: &results }, folder: None };
    let table = protocol_tables(&[store.source], Mixing::Apart).unwrap().swap_remove(0);
    let size = table.columns().find(|(_, column)| column.quantity == Quantity::Gaussians).unwrap().0;
    let cited = |method: &str| {
        let row = table.rows.iter().find(|row| row.method.as_deref() == Some(method) && !row.without_leaked).unwrap();
        cite::citation(&table, row, size, &[store]).unwrap()
    };
    assert!(
        cited("nearest-view").starts_with("#Gauss. 52K, stated, not counted, without trials that failed"),
        "{}",
        cited("nearest-view")
    );
    assert!(!cited("atsplat").contains("stated"), "{}", cited("atsplat"));
}

/// The second hash is not that of the published file.
#[test]
fn a_citation_names_the_learned_weights_of_its_metric() {
    let cited = |hash: &str| {
        let mut results = results_over(vec![preset("rooms-2v-128")], vec![atsplat("atsplat", |_| ())], 7);
        for record in results.provenance.metrics.iter_mut().filter(|record| record.id == "lpips") {
            (record.weights_sha256, record.absent) = (Some(hash.to_owned()), None);
        }
        for row in &mut results.targets {
            row.not_computed.clear();
            row.scores.insert("lpips".to_owned(), 0.25);
        }
        let store = PageStore { source: Source { label: LABEL, results: &results }, folder: None };
        let table = protocol_tables(&[store.source], Mixing::Apart).unwrap().swap_remove(0);
        let row = table.rows.iter().find(|row| !row.without_leaked).unwrap();
        let (lpips, _) = table.columns().find(|(_, column)| column.title == "LPIPS").unwrap();
        [FIRST, lpips].map(|index| cite::citation(&table, row, index, &[store]).unwrap())
    };
    let [psnr, lpips] = cited("397923af8e79cdbb");
    assert!(lpips.contains(", weights 397923af8e79; ") && !psnr.contains("397923af"), "{lpips}");
    let [_, other] = cited("0123456789abcdef");
    assert!(other.contains(", weights 0123456789ab (not the published ones); "), "{other}");
}

/// The reference is of another store.
#[test]
fn a_citation_of_a_difference_names_both_methods() {
    let [first, mut second] = [atsplat("atsplat", |_| ()), nearest_view()]
        .map(|method| results_over(vec![preset("rooms-2v-128")], vec![method], 7));
    second.targets.iter_mut().for_each(|row| row.scores.values_mut().for_each(|score| *score -= 1.0));
    second.provenance.processor = "another processor".to_owned();
    let store = |(label, results)| PageStore { source: Source { label, results }, folder: None };
    let stores = [("one", &first), ("two", &second)].map(store);
    let choice = Choice { against: Some("nearest-view".to_owned()), ..Choice::default() };
    let definition = TableDefinition::named("re10k").unwrap().with_choice(&choice);
    let table = tables(&definition, &stores.map(|store| store.source), Mixing::Apart).unwrap().swap_remove(0);
    let index = CellIndex { group: table.groups.len() - 1, column: 0 };
    let of = |method: &str| {
        let row = table.rows.iter().find(|row| row.method.as_deref() == Some(method) && !row.without_leaked).unwrap();
        cite::citation(&table, row, index, &stores)
    };
    assert_eq!(of("nearest-view"), None, "no difference to itself");
    let citation = of("atsplat").unwrap();
    for expected in [
        "ΔPSNR +1.00 [95 % ",
        "] over 7 scenes, 21 targets (paired difference to nearest-view); method ATSplat, weights 0123456789ab, ",
        "; minus method Nearest view; protocol rooms-2v-128@",
        "; psnr: ",
        ", a processor, 2 threads; atsplat 0.1.0 at ",
        ", another processor, 2 threads",
    ] {
        assert!(citation.contains(expected), "{expected}: {citation}");
    }
    assert_eq!(citation.matches("; protocol ").count(), 1, "one protocol: {citation}");
}

/// Two trainings in two stores, one from another machine.
#[test]
fn a_citation_of_a_mean_over_trainings_names_every_store() {
    let trained = |seed: &str| MethodRecord {
        weights_sha256: Some(seed.repeat(16)),
        training: Some(TrainingRecord { data: "simulated rooms".to_owned(), seed: Some(seed.to_owned()) }),
        ..atsplat(&format!("seed {seed}"), |_| ())
    };
    let mut all = ["1234", "abcd"].map(|seed| results_over(vec![preset("rooms-2v-128")], vec![trained(seed)], 7));
    all[1].provenance.processor = "another processor".to_owned();
    let store = |(label, results)| PageStore { source: Source { label, results }, folder: None };
    let stores = [("one", &all[0]), ("two", &all[1])].map(store);
    let sources = stores.map(|store| store.source);
    let table = tables(&TableDefinition::named("re10k").unwrap(), &sources, Mixing::Apart).unwrap().swap_remove(0);
    let mean = table.rows.iter().find(|row| row.is_over_trainings()).unwrap();
    let citation = cite::citation(&table, mean, FIRST, &stores).unwrap();
    for expected in [
        " of 2 trainings; method ATSplat; ",
        "; training seed 1234 of store one, weights 123412341234, constants gsplat, backend cpu; ",
        "; training seed abcd of store two, weights abcdabcdabcd, ",
        ", a processor, 2 threads; atsplat 0.1.0 at ",
        ", another processor, 2 threads",
    ] {
        assert!(citation.contains(expected), "{expected}: {citation}");
    }
    assert_eq!(citation.matches("; protocol ").count(), 1, "one protocol: {citation}");
}

/// Screen readers name a landmark by its label, and read headings of columns aloud.
#[test]
fn landmarks_have_different_names_and_no_heading_is_empty() {
    let page = Sample::new().write(usize::MAX, None);
    let titles = page.split("<h2 id=").skip(1).filter_map(|rest| Some(rest.split_once('>')?.1.split_once('<')?.0));
    let regions = |text: &'_ str| -> Vec<String> {
        let labels = text.split("role=\"region\" aria-label=\"").skip(1);
        labels.filter_map(|rest| Some(rest.split_once('"')?.0.to_owned())).collect()
    };
    let mut names: Vec<String> = titles.map(str::to_owned).chain(regions(&page)).collect();
    assert!(names.len() > 8 && names.iter().any(|name| name == "Scenes"), "{names:?}");
    let presets = vec![preset("rooms-2v-128"), preset("rooms-2v-64")];
    let results = results(presets, vec![atsplat("atsplat", |_| ())]);
    let source = Source { label: LABEL, results: &results };
    let twins = tables(&TableDefinition::named("re10k").unwrap(), &[source], Mixing::Apart).unwrap();
    assert_eq!(twins[0].title, twins[1].title);
    for names in [&mut names, &mut regions(&tables::write(&twins, &[]))] {
        let all = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all, "{names:?}");
    }
    let headings = page.split("<th").skip(1).filter_map(|rest| Some(rest.split_once('>')?.1));
    assert!(headings.clone().count() > 20 && headings.clone().all(|inside| !inside.starts_with("</th>")));
}

/// Notebooks have no style for classes.
#[test]
fn the_best_and_the_second_best_are_marked_without_a_style() {
    let tables = tables(&TableDefinition::named("re10k").unwrap(), &[], Mixing::Apart).unwrap();
    let html = table_html(&tables[0]);
    assert!(html.contains("<b>28.65</b>") && html.contains("<u>28.54</u>"), "{html}");
}

#[test]
fn facts_of_one_kind_share_their_name() {
    let results = results(vec![preset("rooms-2v-128")], vec![atsplat("atsplat", |_| ()), nearest_view()]);
    let card = facts::origin([(LABEL, &results.provenance)]);
    assert_eq!(card.matches("<dt>Method</dt><dd>atsplat (").count(), 1, "{card}");
    assert!(card.contains("</dd><dd>nearest-view (nearest-view): Nearest view</dd>"), "{card}");
    let names: Vec<&str> = card.split("<dt>").skip(1).filter_map(|rest| Some(rest.split_once('<')?.0)).collect();
    assert_eq!(names, ["atsplat", "Machine", "Command", "Schema", "Protocol", "Method", "Skipped"]);
}

/// A store that was extended, and one that was merged from 24 parts.
#[test]
fn every_command_of_a_store_is_shown() {
    let mut results = results(vec![preset("rooms-2v-128")], vec![nearest_view()]);
    results.provenance.command = vec!["run".to_owned(), "--limit=3".to_owned()];
    results.provenance.add_command(&["run".to_owned(), "--limit=<all>".to_owned()]);
    let card = |results: &Results| facts::origin([(LABEL, &results.provenance)]);
    let text = card(&results);
    assert!(text.contains("<dt>Commands (2)</dt><dd>run --limit=3</dd><dd>run --limit=&lt;all&gt;</dd><dt>"), "{text}");
    for part in 1..=22 {
        results.provenance.add_command(&[format!("part-{part}")]);
    }
    let text = card(&results);
    assert!(text.contains("<dt>Commands (24)</dt>") && text.contains("part-18</dd><dd>… (the others"), "{text}");
    assert!(!text.contains("part-19"), "{text}");
}

/// Two stores of one protocol, and one of another; a method of all three, and one with random weights in two of them.
#[test]
fn protocols_and_methods_of_several_stores_count_once() {
    let untrained = MethodRecord { weights_sha256: None, untrained: true, ..atsplat("atsplat", |_| ()) };
    let mut all =
        ["rooms-2v-128", "rooms-2v-128", "rooms-2v-64"].map(|name| results(vec![preset(name)], vec![nearest_view()]));
    for results in &mut all[1..] {
        results.provenance.methods.push(untrained.clone());
    }
    let store = |results| PageStore { source: Source { label: LABEL, results }, folder: None };
    let text = facts::summary(&[], &all.each_ref().map(store));
    for expected in [
        "<b>2</b><span>protocols</span>",
        "<b>2</b><span>methods</span>",
        "1 of 2 methods have",
        "<b>12</b><span>trials</span>",
    ] {
        assert!(text.contains(expected), "{text}");
    }
    let text = facts::summary(&[], &[store(&all[0])]);
    assert!(text.contains("<b>1</b><span>protocol</span>"), "{text}");
}

#[test]
fn slots_are_filled_in_one_pass() {
    assert_eq!(filled("a {{x}} b {{y}}{{z}}", &[("x", "{{y}}".to_owned()), ("y", "1".to_owned())]), "a {{y}} b 1");
    assert_eq!(filled("open {{x", &[]), "open {{x");
}
