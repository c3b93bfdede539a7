//! What `reports/claims` and `reports/re10k-scene` say is what their stores contain.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail like tests")]

mod leads;

use std::path::{Path, PathBuf};

use atsplat_protocol::Aggregation;
use atsplat_report::definition::TableDefinition;
use atsplat_report::emit::{TableFormat, orders_as_markdown};
use atsplat_report::table::{Mixing, Source, Table, protocol_tables, tables};
use atsplat_results::Results;
use atsplat_results::statistics::{
    Identical, Leaked, MetricQuery, common_scene_means, interval_of_mean, paired_between, summary,
};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../reports/claims")
}

/// A metric of one row minus that of another under `rooms-2v-64`, as [`difference_under`].
fn difference(rows: [(&Results, &str); 2], metric: &'static str, decimals: usize) -> String {
    difference_under(("rooms-2v-64", 200, 600), rows, metric, decimals)
}

/// A metric of one row minus that of another, paired over the scenes of both, with its interval; the protocol's name, scenes and
/// targets come first.
fn difference_under(
    (preset, scenes, targets): (&'static str, u64, u64),
    rows: [(&Results, &str); 2],
    metric: &'static str,
    decimals: usize,
) -> String {
    let [first, second] = rows.map(|(results, method)| (results, query(preset, method, metric)));
    let found = paired_between((first.0, &first.1), (second.0, &second.1), Aggregation::SceneMeans).unwrap();
    assert_eq!((found.scenes, found.targets, found.unpaired), (scenes, targets, 0), "{} and {}", rows[0].1, rows[1].1);
    with_interval(found.difference, found.interval.unwrap(), decimals)
}

/// `+0.194 [+0.147, +0.238]`.
fn with_interval(value: f64, [low, high]: [f64; 2], decimals: usize) -> String {
    format!("{value:+.decimals$} [{low:+.decimals$}, {high:+.decimals$}]").replace('-', "−")
}

/// The same in decibels: `+0.194 dB [+0.147, +0.238]`.
fn in_decibels(interval: &str) -> String {
    interval.replacen(" [", " dB [", 1)
}

fn query<'a>(preset: &'a str, method: &'a str, metric: &'static str) -> MetricQuery<'a> {
    MetricQuery { preset, method, metric, leaked: Leaked::Included, identical: Identical::Excluded }
}

/// Every expected line has to be on a page; all that are lacking are named.
fn require_lines(mut expected: Vec<String>, is_there: impl Fn(&String) -> bool) {
    expected.retain(|line| !is_there(line));
    assert!(expected.is_empty(), "lines that the page lacks:\n{}", expected.join("\n"));
}

/// Two rows, each with the stores of its trainings: the first, the second and so on.
struct Claim {
    text: &'static str,
    above: (&'static str, &'static [&'static str]),
    below: (&'static str, &'static [&'static str]),
}

const SPARSE: [&str; 3] = ["expansion-sparse", "expansion-sparse-seed-2", "expansion-sparse-seed-3"];

const SPARSEST: [&str; 3] = ["expansion-sparsest", "expansion-sparsest-seed-2", "expansion-sparsest-seed-3"];

/// The second training is on images of generation 2 of the simulator, on which its three rows were evaluated too.
const DIRECT: [&str; 2] = ["anchors", "anchors-seed-2-generation-2"];

const CLAIMS: [Claim; 18] = [
    Claim { text: "uncertainty above random selection", above: ("k-4", &SPARSE), below: ("sparse-random", &SPARSE) },
    Claim {
        text: "uncertainty above farthest-point sampling",
        above: ("k-4", &SPARSE),
        below: ("sparse-farthest-point", &SPARSE),
    },
    Claim {
        text: "uncertainty above straight-through selection",
        above: ("k-4", &SPARSE),
        below: ("sparse-straight-through", &["expansion-sparse-straight-through", SPARSE[1], SPARSE[2]]),
    },
    Claim {
        text: "uncertainty above no expansion with an equal number of Gaussians",
        above: ("k-4", &SPARSE),
        below: ("sparse-none-k11", &SPARSE),
    },
    Claim {
        text: "random selection above no expansion",
        above: ("sparse-random", &SPARSE),
        below: ("sparse-none-k11", &SPARSE),
    },
    Claim {
        text: "farthest-point sampling above no expansion",
        above: ("sparse-farthest-point", &SPARSE),
        below: ("sparse-none-k11", &SPARSE),
    },
    Claim {
        text: "straight-through selection above no expansion",
        above: ("sparse-straight-through", &["expansion-sparse-straight-through", SPARSE[1], SPARSE[2]]),
        below: ("sparse-none-k11", &SPARSE),
    },
    Claim {
        text: "at half of the density and twice the learning rate: uncertainty above random selection",
        above: ("sparser", &["expansion-sparser"]),
        below: ("sparser-random", &["expansion-sparser"]),
    },
    Claim {
        text: "at a quarter of the density: uncertainty above random selection",
        above: ("k-1", &SPARSEST),
        below: ("sparsest-random", &SPARSEST),
    },
    Claim {
        text: "the same: uncertainty above farthest-point sampling",
        above: ("k-1", &SPARSEST),
        below: ("sparsest-farthest-point", &SPARSEST),
    },
    Claim {
        text: "the same: uncertainty above straight-through selection",
        above: ("k-1", &SPARSEST),
        below: ("sparsest-straight-through", &SPARSEST),
    },
    Claim {
        text: "the same: uncertainty above no expansion with 384 Gaussians in place of 360",
        above: ("k-1", &SPARSEST),
        below: ("sparsest-none-k3", &SPARSEST),
    },
    Claim {
        text: "anchor + offset above ray + depth; offsets in the axes and units of the patch",
        above: ("full", &["anchors", "anchors-seed-2"]),
        below: ("anchor-ray-depth", &["anchors", "anchors-seed-2"]),
    },
    Claim {
        text: "the same; offsets in the axes of the world",
        above: ("anchor-offset", &["anchors-in-world-axes", "anchors-seed-2"]),
        below: ("anchor-ray-depth", &["anchors-in-world-axes", "anchors-seed-2"]),
    },
    Claim {
        text: "ray + depth above learnable anchors with direct positions",
        above: ("anchor-ray-depth", &DIRECT),
        below: ("anchor-learnable", &DIRECT),
    },
    Claim {
        text: "learnable anchors above none, both with direct positions",
        above: ("anchor-learnable", &DIRECT),
        below: ("anchor-direct-xyz", &DIRECT),
    },
    Claim {
        text: "8 Gaussians per token above 4",
        above: ("k-8", &["gaussians", "gaussians-seed-2"]),
        below: ("k-4", &["gaussians", SPARSE[1]]),
    },
    Claim {
        text: "16 Gaussians per token above 8",
        above: ("full", &["gaussians", "anchors-seed-2"]),
        below: ("k-8", &["gaussians", "gaussians-seed-2"]),
    },
];

/// Each claim that was trained several times has a line with the difference of every training.
#[test]
fn differences_of_several_trainings_are_those_of_the_stores() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let read = |name: &str| Results::read(&folder().join(name).join("store")).unwrap();
    let line = |Claim { text, above, below }: &Claim| {
        assert_eq!(above.1.len(), below.1.len(), "{text}");
        let mut line = format!("| {text} |");
        for (training, (first, second)) in (1..).zip(above.1.iter().zip(below.1)) {
            let [first_row, second_row] = [above.0, below.0].map(|row| format!("{row}-{training}"));
            let difference = difference([(&read(first), &first_row), (&read(second), &second_row)], "psnr", 3);
            line = format!("{line} {difference} |");
        }
        line
    };
    require_lines(CLAIMS.iter().map(line).collect(), |expected| readme.lines().any(|line| line.starts_with(expected)));
}

/// Selection by uncertainty against each other one after three times the samples.
#[test]
fn differences_of_longer_trainings_are_those_of_the_store() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let results = Results::read(&folder().join("expansion-sparse-long/store")).unwrap();
    let expected = [
        ("random selection", "sparse-random-long-1"),
        ("farthest-point sampling", "sparse-farthest-point-long-1"),
        ("straight-through selection", "sparse-straight-through-long-1"),
    ]
    .map(|(selection, row)| {
        let interval = difference([(&results, "k-4-long-1"), (&results, row)], "psnr", 3);
        format!("| uncertainty above {selection}, after three times the samples | {interval} |")
    });
    require_lines(expected.to_vec(), |expected| readme.lines().any(|line| line == expected));
    let farthest = |other: &str| {
        let rows = ["sparse-farthest-point-long-1", other].map(|row| (&results, row));
        difference(rows, "psnr", 3)
    };
    let [straight_through, random] = ["sparse-straight-through-long-1", "sparse-random-long-1"].map(farthest);
    let largest = format!("{straight_through} and {}", in_decibels(&random));
    require_lines(vec![largest], |text| readme.contains(text));
}

/// Learnt tokens against none after twice the samples.
#[test]
fn numbers_of_direct_positions_are_those_of_the_store() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let results = Results::read(&folder().join("anchors-long/store")).unwrap();
    let rows = ["anchor-learnable-long-1", "anchor-direct-xyz-long-1"];
    let interval = in_decibels(&difference(rows.map(|row| (&results, row)), "psnr", 3));
    let [learnt, none] = rows.map(|row| {
        let found = summary(&results, &query(ROOMS.0, row, "psnr"), Aggregation::SceneMeans);
        format!("{:.2}", found.mean.unwrap())
    });
    for expected in [
        format!("| the same after twice the samples | +3.75 dB | {interval} | reversed |"),
        format!("without anchors to {none} dB and that with learnable ones to {learnt} dB"),
    ] {
        assert!(readme.replace('\n', " ").contains(&expected), "the page lacks: {expected}");
    }
}

/// What each part of a training's recipe changes, in PSNR and SSIM.
#[test]
fn trials_of_the_recipe_are_those_of_the_store() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let parts = [
        ("averaged weights", "recipe-average-1"),
        ("mirrored samples", "recipe-flips-1"),
        ("narrow windows first", "recipe-curriculum-1"),
        ("anchors pulled to exact distances", "recipe-distances-1"),
        ("more D-SSIM in the last quarter", "recipe-late-d-ssim-1"),
        ("all five", "recipe-all-1"),
    ];
    let rates_and_targets = [
        ("half the peak", "recipe-half-rate-1"),
        ("twice the peak", "recipe-double-rate-1"),
        ("half the peak throughout, averaged weights", "recipe-constant-rate-1"),
        ("targets between the context views only", "recipe-targets-inside-1"),
        ("targets up to 45 frames outside", "recipe-targets-outside-1"),
    ];
    for (store, rows) in [("recipe", &parts[..]), ("recipe-generation-2", &rates_and_targets[..])] {
        let results = Results::read(&folder().join(store).join("store")).unwrap();
        let line = |(part, row): &(&str, &str)| {
            let difference =
                |metric, decimals| difference([(&results, *row), (&results, "recipe-plain-1")], metric, decimals);
            format!("| {part} | {} | {} |", difference("psnr", 3), difference("ssim", 4))
        };
        require_lines(rows.iter().map(line).collect(), |line| readme.contains(line));
    }
}

/// Thresholds against fixed ratios, and how much more the first step of Gaussians per token gains than the second.
#[test]
fn lines_on_budgets_are_those_of_the_stores() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let read = |name: &str| Results::read(&folder().join(name).join("store")).unwrap();
    let thresholds = read("thresholds");
    let mut expected = ["0.2 0.2 0.6", "0.6 0.6 0.8", "0.8 0.8 0.9"]
        .map(|quantiles| {
            let row = format!("quantiles {quantiles}");
            in_decibels(&difference([(&thresholds, &row), (&thresholds, "fixed ratios")], "psnr", 3))
        })
        .to_vec();
    let steps = |[few, some, many]: [(&Results, &str); 3]| {
        let queries = [few, some, many].map(|(results, row)| (results, query(ROOMS.0, row, "psnr")));
        let means = common_scene_means(&queries, Aggregation::SceneMeans);
        let [few, some, many] = means.try_into().expect("as many as queries");
        assert_eq!([few.len(), some.len(), many.len()], [200; 3]);
        let scenes = few.iter().zip(&some).zip(&many);
        let bends: Vec<[f64; 2]> =
            scenes.map(|((few, some), many)| [(some.mean - few.mean) - (many.mean - some.mean), 1.0]).collect();
        let mean = bends.iter().map(|[bend, _]| bend).sum::<f64>() / 200.0;
        in_decibels(&with_interval(mean, interval_of_mean(&bends).unwrap(), 3))
    };
    let first = read("gaussians");
    let [few, some, many] = ["expansion-sparse-seed-2", "gaussians-seed-2", "anchors-seed-2"].map(read);
    expected.push(steps([(&first, "k-4-1"), (&first, "k-8-1"), (&first, "full-1")]));
    expected.push(steps([(&few, "k-4-2"), (&some, "k-8-2"), (&many, "full-2")]));
    require_lines(expected, |number| readme.contains(number));
}

const ROOMS: (&str, u64, u64) = ("rooms-2v-64", 200, 600);
const YARDS: [(&str, u64, u64); 3] =
    [("yards-2v-128x224", 12, 48), ("yards-4v-128x224", 12, 48), ("yards-6v-128x224", 12, 48)];

/// Selection on yards, where images have more detail, and more views of the same targets.
#[test]
fn lines_on_yards_and_on_views_are_those_of_the_stores() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let [yards, views] =
        ["expansion-yards", "views"].map(|name| Results::read(&folder().join(name).join("store")).unwrap());
    let on_yards = |above, below| {
        let rows = [(&yards, above), (&yards, below)];
        in_decibels(&difference_under(("yards-2v-64", 200, 600), rows, "psnr", 3))
    };
    let of_views = |[more, fewer]: [(&'static str, u64, u64); 2]| {
        let [more, fewer] = [more, fewer].map(|(preset, ..)| query(preset, "atsplat", "psnr"));
        let found = paired_between((&views, &more), (&views, &fewer), Aggregation::SceneMeans).unwrap();
        assert_eq!((found.scenes, found.targets, found.unpaired), (12, 48, 0));
        with_interval(found.difference, found.interval.unwrap(), 2)
    };
    require_lines(
        vec![
            on_yards("yards-1", "yards-random-1"),
            on_yards("yards-1", "yards-none-k11-1"),
            on_yards("yards-random-1", "yards-none-k11-1"),
            of_views([YARDS[1], YARDS[0]]),
            of_views([YARDS[2], YARDS[1]]),
        ],
        |number| readme.contains(number),
    );
}

/// One network for all settings against one for each, and networks on scenes that they never saw.
#[test]
fn lines_on_unified_and_separate_networks_are_those_of_the_stores() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let [results, zero_shot] =
        ["unified", "zero-shot"].map(|name| Results::read(&folder().join(name).join("store")).unwrap());
    let mean = |results: &Results, preset: &str, method: &str| {
        let found = summary(results, &query(preset, method, "psnr"), Aggregation::SceneMeans);
        format!("{:.2}", found.mean.unwrap())
    };
    let mut expected = Vec::new();
    for (setting, protocol, separate) in [
        ("rooms, 2 views", ROOMS, "separate-rooms-1"),
        ("yards, 2 views", YARDS[0], "separate-yards-2v-1"),
        ("yards, 4 views", YARDS[1], "separate-yards-4v-1"),
        ("yards, 6 views", YARDS[2], "separate-yards-6v-1"),
    ] {
        let [separate_mean, unified_mean] = [separate, "unified-1"].map(|method| mean(&results, protocol.0, method));
        let difference = difference_under(protocol, [(&results, "unified-1"), (&results, separate)], "psnr", 3);
        expected.push(format!("| {setting} | {separate_mean} | {unified_mean} | {difference} |"));
    }
    for (setting, protocol, other, trained) in [
        ("yards, by the network for rooms", YARDS[0], "separate-rooms-1", "separate-yards-2v-1"),
        ("rooms, by the network for yards", ROOMS, "separate-yards-2v-1", "separate-rooms-1"),
    ] {
        let difference = difference_under(protocol, [(&zero_shot, other), (&results, trained)], "psnr", 3);
        expected.push(format!("| {setting} | {} | {difference} |", mean(&zero_shot, protocol.0, other)));
    }
    require_lines(expected, |line| readme.contains(line));
}

/// The tables of the real scene, and the numbers that its page quotes.
#[test]
fn tables_of_the_real_scene_are_those_of_its_store() {
    let folder = folder().join("../re10k-scene");
    let results = Results::read(&folder.join("store")).unwrap();
    let built = protocol_tables(&[Source { label: "store", results: &results }], Mixing::Apart).unwrap();
    assert_eq!(built.len(), 2);
    for table in built {
        let committed = std::fs::read_to_string(folder.join(format!("{}.md", table.name))).unwrap();
        assert_eq!(TableFormat::Markdown.write(&table).unwrap(), committed, "{}", table.name);
    }
    let page = std::fs::read_to_string(folder.join("README.md")).unwrap();
    for preset in ["re10k-2v-256", "re10k-overlap"] {
        let line = page.lines().find(|line| line.starts_with(&format!("| [`{preset}`]"))).unwrap().replace("**", "");
        let quoted: Vec<String> = ["atsplat", "warp", "nearest-view"]
            .iter()
            .map(|method| {
                let mean = |metric: &str| {
                    let scores: Vec<f64> = results.targets_of(preset, method).map(|row| row.scores[metric]).collect();
                    assert_eq!(scores.len(), 3);
                    scores.iter().sum::<f64>() / 3.0
                };
                format!("{:.2}, {:.3}", mean("psnr"), mean("ssim"))
            })
            .collect();
        let quoted = format!("| {} |", quoted.join(" | "));
        assert!(line.ends_with(&quoted), "{line}: {quoted}");
    }
}

#[test]
fn published_orders_are_those_of_the_stores() {
    let mut compared = 0;
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        if !path.join("store").is_dir() {
            continue;
        }
        let results = Results::read(&path.join("store")).unwrap();
        let source = Source { label: "store", results: &results };
        let built: Vec<_> = TableDefinition::names()
            .flat_map(|name| tables(&TableDefinition::named(name).unwrap(), &[source], Mixing::Apart).unwrap())
            .filter(Table::is_measured)
            .collect();
        // The others show the tables of their protocols.
        let (built, file) = if let Some(orders) = orders_as_markdown(&built) {
            (orders, "orders.md")
        } else {
            let protocols = protocol_tables(&[source], Mixing::Apart).unwrap();
            let texts: Vec<String> =
                protocols.iter().map(|table| TableFormat::Markdown.write(table).unwrap()).collect();
            (texts.join("\n"), "protocol.md")
        };
        let committed = std::fs::read_to_string(path.join(file)).unwrap();
        assert_eq!(built, committed, "{}", path.display());
        compared += 1;
    }
    assert!(compared > 0, "no claims");
}
