use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::method::{BROKEN, DRAWN_CLASSIC};
use atsplat_eval::statistics::{CONFIDENCE, MIN_SCENES, Trend, along_setting, cost};
use atsplat_eval::{MethodRecord, TrialRow};
use atsplat_metrics::{Definition, Measure};

use super::edition::{Edition, Part};
use super::leads::changes_of_leads;
use super::orders::means;
use super::time_scope::was_busy;
use super::{
    BUSY, Cell, CellTiming, Counts, Group, Note, NoteKind, Row, StoreProtocol, Table, Trainings, Value, distinct,
};
use crate::counted;
use crate::definition::{PlotKind, Quantity, TableDefinition};
use crate::plot::Origin;

/// Everything that readers must know about a table.
pub(super) fn footer(table: &Table, definition: &TableDefinition, edition: Option<&Edition<'_>>) -> Vec<Note> {
    let mut notes = Notes::default();
    if !definition.source.is_empty() {
        notes.add(NoteKind::Published, format!("paper: {}", definition.source));
    }
    for note in &definition.notes {
        notes.add(NoteKind::Published, note.clone());
    }
    let Some(edition) = edition.filter(|_| table.is_measured()) else { return notes.list };
    if edition.mixed {
        notes.add(
            NoteKind::Forced,
            "because of --force, this table mixes rows of different protocols, or of different images under one name; \
             they are not comparable"
                .to_owned(),
        );
    }
    if let Some(apart) = &edition.apart {
        notes.add(NoteKind::Setting, apart.clone());
    }
    protocols(&mut notes, table, edition);
    metrics(&mut notes, table, edition);
    times(&mut notes, table);
    for row in table.rows.iter().filter(|row| row.origin == Origin::Measured) {
        counts(&mut notes, table, row);
        doubtful(&mut notes, row, edition);
        intervals(&mut notes, table, row);
    }
    few_scenes(&mut notes, table);
    left_out(&mut notes, table);
    several_trainings(&mut notes, table);
    if let Some(text) = trend_over_gaussians(table, definition, edition) {
        notes.add(NoteKind::Trend, text);
    }
    for text in changes_of_leads(table, definition, edition) {
        notes.add(NoteKind::Trend, text);
    }
    trained_on(&mut notes, table, edition);
    if table.rows.iter().any(|row| row.untrained) {
        notes.add(
            NoteKind::Untrained,
            "untrained: random weights; such rows are not ranked, and their quality says nothing about the method"
                .to_owned(),
        );
    }
    if table.rows.iter().any(|row| row.not_retrained) {
        notes.add(
            NoteKind::Setting,
            "changed at inference only: the weights of another row in a network that was changed after training; for an \
             ablation the paper trains one, unless it changes only thresholds or how many blocks expand"
                .to_owned(),
        );
    }
    if table.rows.iter().any(|row| row.without_leaked) {
        let text = "without context frames: targets that are also context frames are left out".to_owned();
        notes.add(NoteKind::Counts, text);
    }
    notes.list
}

/// Numbers without intervals, because their scenes are too few.
fn few_scenes(notes: &mut Notes, table: &Table) {
    let cells = table.rows.iter().flat_map(|row| row.cells.iter().flatten());
    let counts = cells.filter(|cell| cell.value.number().is_some()).filter_map(|cell| cell.counts);
    if counts.map(|counts| counts.scenes).any(|scenes| scenes < MIN_SCENES) {
        notes.add(NoteKind::LeftOut, format!("no interval with fewer than {MIN_SCENES} scenes"));
    }
}

fn left_out(notes: &mut Notes, table: &Table) {
    let cells = table.rows.iter().flat_map(|row| row.cells.iter().flatten());
    if cells.filter_map(|cell| cell.counts).any(|counts| counts.identical > 0) {
        let text =
            "renders that are identical to the truth, whose PSNR is infinite, are counted and left out of all means";
        notes.add(NoteKind::LeftOut, text.to_owned());
    }
}

fn several_trainings(notes: &mut Notes, table: &Table) {
    for row in &table.rows {
        for (place, column) in table.columns() {
            let Some(Trainings { count, training_deviation, scene_deviation }) = row.cell(place).trainings else {
                continue;
            };
            let deviations = [training_deviation, scene_deviation].map(|value| column.format(value));
            let text = format!(
                "{}: {} has the standard deviation {} over {count} trainings and {} over scenes; its interval is for both",
                name(row),
                column.title,
                deviations[0],
                deviations[1],
            );
            notes.add(NoteKind::Trainings, text);
        }
    }
}

/// The slope over the number of Gaussians, in tables whose rows are budgets of one protocol.
fn trend_over_gaussians(table: &Table, definition: &TableDefinition, edition: &Edition<'_>) -> Option<String> {
    let budgets = matches!(definition.plot, Some(PlotKind::KScaling | PlotKind::BudgetHistogram));
    let preset = definition.groups.first().filter(|_| budgets)?.preset.as_deref()?;
    let metric = table.columns().find_map(|(_, column)| match column.quantity {
        Quantity::Metric(metric) => Some(metric),
        _ => None,
    })?;
    let rows = table.rows.iter().filter(|row| row.origin == Origin::Measured && !row.without_leaked);
    let settings = rows.filter_map(|row| {
        let (part, record) = edition.method(preset, row)?;
        let gaussians = cost(part.source.results, &part.preset.name, &record.name).gaussians?;
        Some((gaussians.log2(), means(&(part, record), metric)))
    });
    let settings: Vec<_> = settings.collect();
    let Trend { slope, interval, scenes } = along_setting(&settings)?;
    let interval = interval_of_slope(interval);
    Some(format!(
        "trend: {} changes by {slope:+.3} {interval} per doubling of Gaussians, over {} settings and {}",
        metric.name,
        settings.len(),
        counted(scenes, "scene")
    ))
}

/// The interval of a slope in a sentence.
pub(super) fn interval_of_slope(interval: Option<[f64; 2]>) -> String {
    match interval {
        Some([low, high]) => format!("[{low:+.3}, {high:+.3}]"),
        None => format!("without an interval: fewer than {MIN_SCENES} scenes"),
    }
}

/// The training data of the networks in the table.
fn trained_on(notes: &mut Notes, table: &Table, edition: &Edition<'_>) {
    for (_, record) in shown(table, edition) {
        if let Some(training) = &record.training {
            notes.add(NoteKind::Convention, format!("{}: trained on {}", record.title, training.data));
        }
    }
}

/// The methods in the table, each with its part of the edition.
fn shown<'a>(table: &Table, edition: &'a Edition<'a>) -> Vec<(&'a Part<'a>, &'a MethodRecord)> {
    // Rows whose groups of columns have methods of their own have no method as a whole.
    let own: Vec<&StoreProtocol> = table.rows.iter().flat_map(|row| row.protocols.iter().flatten()).collect();
    let methods = |part: &'a Part<'a>| part.source.results.provenance.methods.iter().map(move |record| (part, record));
    let all = edition.parts.iter().flat_map(methods);
    all.filter(|(part, record)| own.iter().any(|own| part.is(own) && own.method == record.name)).collect()
}

/// Methods that are rendered as the protocol lists for the published method whose setting they name.
fn renderers_of_settings(notes: &mut Notes, table: &Table, edition: &Edition<'_>) {
    const OF_PRESET: &str = "of the preset";
    for (part, record) in shown(table, edition) {
        let parameter = |name: &str| record.parameters.get(name).and_then(|value| value.as_str());
        let is_listed = |setting: &&str| part.protocol.renderer_overrides_of(setting).is_some();
        let Some(setting) = parameter("setting").filter(is_listed) else { continue };
        if record.constants.as_deref() == Some(OF_PRESET) {
            let renderer = part.protocol.renderer_for(setting);
            let background = parameter("background").filter(|chosen| *chosen == OF_PRESET);
            let background = background.map_or_else(String::new, |_| format!(", on {:?}", renderer.background));
            let (preset, rasteriser) = (&part.preset.name, &renderer.rasteriser);
            let text =
                format!("{} is rendered as {preset} lists for {setting}: {rasteriser}{background}", record.title);
            notes.add(NoteKind::Convention, text);
        }
    }
}

/// Distinct notes, in order.
#[derive(Default)]
struct Notes {
    list: Vec<Note>,
}

impl Notes {
    fn add(&mut self, kind: NoteKind, text: String) {
        let note = Note { kind, text };
        if !self.list.contains(&note) {
            self.list.push(note);
        }
    }
}

fn protocols(notes: &mut Notes, table: &Table, edition: &Edition<'_>) {
    for part in &edition.parts {
        let Part { preset, source, .. } = part;
        let index = preset.index_name.as_deref().unwrap_or(&preset.index);
        notes.add(
            NoteKind::Convention,
            format!(
                "{}: protocol {}, index {index} {}, data {}",
                preset.name,
                short(&preset.hash),
                short(&preset.index_sha256),
                preset.dataset,
            ),
        );
        let difference = part.difference(&part.methods_in(&table.rows));
        for difference in difference.iter().chain(&part.unfinished) {
            notes.add(NoteKind::Setting, format!("not the published setting: {difference}"));
        }
        if let Some(why) = part.forced_overlaps().filter(|_| edition.forced) {
            notes.add(NoteKind::Forced, format!("{why}; they are binned nevertheless because of --force"));
        }
        for warning in source.results.provenance.warnings.iter().filter(|warning| warning.preset == preset.name) {
            notes.add(
                NoteKind::Counts,
                format!("{}: {} {}: {}", preset.name, warning.count, warning.kind, warning.example),
            );
        }
        let skipped = source.results.provenance.skipped.iter().filter(|entry| entry.preset == preset.name);
        // Methods with other poses may give other reasons for one entry.
        let entries = skipped.map(|entry| (entry.scene.as_str(), entry.entry)).collect::<BTreeSet<_>>().len() as u64;
        if entries > 0 {
            let text = format!("{}: {} skipped ({})", preset.name, counted(entries, "index entry"), reasons(part));
            notes.add(NoteKind::Counts, text);
        }
    }
    let constants: BTreeSet<(&str, &str)> = edition
        .parts
        .iter()
        .flat_map(|part| &part.source.results.provenance.methods)
        .filter_map(|method| Some((method.constants.as_deref()?, method.backend.as_deref().unwrap_or("not recorded"))))
        .collect();
    for (constants, backend) in constants {
        notes.add(NoteKind::Convention, format!("renderer: constants {constants}, backend {backend}"));
    }
    renderers_of_settings(notes, table, edition);
}

/// Reasons of skipped entries, counted.
fn reasons(part: &Part<'_>) -> String {
    let skipped = part.source.results.provenance.skipped.iter().filter(|entry| entry.preset == part.preset.name);
    let mut counts: Vec<(&str, u64)> = Vec::new();
    for entry in skipped {
        match counts.iter_mut().find(|(reason, _)| *reason == entry.reason) {
            Some((_, count)) => *count += 1,
            None => counts.push((&entry.reason, 1)),
        }
    }
    counts.iter().map(|(reason, count)| format!("{reason} {count}")).collect::<Vec<_>>().join(", ")
}

fn metrics(notes: &mut Notes, table: &Table, edition: &Edition<'_>) {
    for (_, column) in table.columns() {
        if let Quantity::Metric(metric) = column.quantity {
            let weights = weights_of(metric, edition);
            let hashes: Vec<String> = weights.keys().map(|hash| short(hash)).collect();
            let text = if hashes.is_empty() { String::new() } else { format!("; weights {}", hashes.join(", ")) };
            notes.add(NoteKind::Convention, format!("{}: {}{text}", metric.name, metric.convention));
            differing_weights(notes, metric, &weights);
        }
    }
    for (place, column) in table.columns() {
        for row in &table.rows {
            let Cell { value, counts, not_computed: Some(reason), .. } = row.cell(place) else { continue };
            let text = match (value, counts) {
                (Value::Number(_), Some(Counts { targets, uncomputed, .. })) => format!(
                    "{} of {}: not computed for {uncomputed} of {}, and not ranked: {reason}",
                    table.heading(place),
                    name(row),
                    counted(targets + uncomputed, "target")
                ),
                _ => format!("n/c {}: not computed: {reason}", column.title),
            };
            notes.add(NoteKind::NotComputed, text);
        }
    }
}

/// The stores behind each hash of a learned metric's weights.
type WeightsOfStores<'a> = BTreeMap<&'a str, BTreeSet<&'a str>>;

fn weights_of<'a>(metric: &Definition, edition: &'a Edition<'a>) -> WeightsOfStores<'a> {
    let mut weights = WeightsOfStores::new();
    for Part { source, .. } in &edition.parts {
        let own = source.results.provenance.metrics.iter().filter(|record| record.id == metric.id);
        for hash in own.filter_map(|record| record.weights_sha256.as_deref()) {
            weights.entry(hash).or_default().insert(source.label);
        }
    }
    weights
}

/// Weights that are not the published ones, or not the same in all stores: a file of the published name may hold any.
fn differing_weights(notes: &mut Notes, metric: &Definition, weights: &WeightsOfStores<'_>) {
    let Measure::Perceptual { network, .. } = metric.measure else { return };
    for hash in weights.keys().filter(|hash| network.is_published(hash) == Some(false)) {
        let text = format!(
            "{}: the weights {} are not those of the published {}: not comparable with published numbers",
            metric.name,
            short(hash),
            network.file()
        );
        notes.add(NoteKind::Setting, text);
    }
    if weights.len() > 1 {
        let stores = |(hash, stores): (&&str, &BTreeSet<&str>)| {
            format!("{} in {}", short(hash), stores.iter().copied().collect::<Vec<_>>().join(", "))
        };
        let all = weights.iter().map(stores).collect::<Vec<_>>().join("; ");
        let text = format!("{}: the weights differ between stores, whose rows are not comparable: {all}", metric.name);
        notes.add(NoteKind::Setting, text);
    }
}

/// Machines, then each time with its spread, then the times that are not reliable.
fn times(notes: &mut Notes, table: &Table) {
    let cells = |row: &'_ Row| row.cells.iter().flatten().filter_map(|cell| cell.timing.clone()).collect::<Vec<_>>();
    let mut busiest: Option<f64> = None;
    for timing in table.rows.iter().flat_map(cells) {
        let machine = format!("Time: {}; separate timing pass, nothing else running in the process", timing.machine);
        notes.add(NoteKind::Convention, machine);
        if timing.busy {
            busiest = [busiest, timing.others].into_iter().flatten().max_by(f64::total_cmp);
        }
    }
    for scope in table.rows.iter().flat_map(|row| row.cells.iter().flatten()).filter_map(Cell::time_scope) {
        notes.add(NoteKind::Convention, scope.explained());
    }
    for row in &table.rows {
        for device in cells(row).into_iter().filter_map(|timing| timing.device) {
            notes.add(NoteKind::Convention, format!("Time of {}: {device}", name(row)));
        }
    }
    for row in &table.rows {
        for CellTiming { spread, trials, trials_there, repetitions, warm_up, .. } in cells(row) {
            let all = if trials == trials_there && trials < 3 { " (all)" } else { "" };
            notes.add(
                NoteKind::Interval,
                format!(
                    "time, {}: median {:.4} s, MAD {:.4}, quartiles {:.4} to {:.4}; {repetitions} repetitions of \
                     {}{all}, {warm_up} warm-up",
                    name(row),
                    spread.median,
                    spread.mad,
                    spread.quartiles[0],
                    spread.quartiles[1],
                    counted(trials, "trial"),
                ),
            );
        }
    }
    if let Some(others) = busiest {
        let why = was_busy(others);
        notes.add(NoteKind::Busy, format!("{BUSY} {why}: such times are unreliable and not ranked"));
    }
}

/// Scenes and targets of a row, and its targets outside all bins; groups of columns with equal counts are listed together.
fn counts(notes: &mut Notes, table: &Table, row: &Row) {
    let mut by_text: Vec<(Vec<&str>, String)> = Vec::new();
    // A slope is over the targets of other columns, which would be listed twice.
    let is_slope = |group: &&Group| group.columns.iter().all(|column| matches!(column.quantity, Quantity::Slope(..)));
    for (own, cells) in table.groups.iter().zip(&row.cells).filter(|(group, _)| !is_slope(group)) {
        let Some(text) = counts_of(cells) else { continue };
        let title = if own.title.is_empty() { "all" } else { own.title.as_str() };
        match by_text.iter_mut().find(|(_, known)| *known == text) {
            Some((groups, _)) => groups.push(title),
            None => by_text.push((vec![title], text)),
        }
    }
    let mut parts: Vec<String> = match by_text.as_slice() {
        [(_, text)] => vec![text.clone()],
        several => several.iter().map(|(groups, text)| format!("{}: {text}", groups.join(", "))).collect(),
    };
    // The same for each bin.
    let outside = row.cells.iter().flatten().filter_map(|cell| cell.counts).map(|counts| counts.outside_bins).max();
    if let Some(outside) = outside.filter(|outside| *outside > 0) {
        parts.push(format!("{} outside all bins of overlap", counted(outside, "target")));
    }
    if !parts.is_empty() {
        notes.add(NoteKind::Counts, format!("{}: {}", name(row), parts.join("; ")));
    }
}

/// Columns of a group have the same targets: the counts of the first computed metric hold for all.
fn counts_of(cells: &[Cell]) -> Option<String> {
    let with_counts: Vec<(&Cell, Counts)> = cells.iter().filter_map(|cell| Some((cell, cell.counts?))).collect();
    let (cell, counts) = with_counts.iter().find(|(_, counts)| counts.targets > 0).or(with_counts.first())?;
    let mut text = cell.counts_in_words()?;
    if with_counts.iter().any(|(_, other)| other.targets > 0 && other.targets != counts.targets) {
        text.push_str(", metrics over different targets");
    }
    Some(text)
}

/// Trials that count in a row's means although their renders show nothing, some of their Gaussians were broken, or they may be meant
/// to be drawn otherwise.
fn doubtful(notes: &mut Notes, row: &Row, edition: &Edition<'_>) {
    // The trials of a mean over trainings, and of a row without context frames, are those of other rows.
    if row.without_leaked || row.is_over_trainings() {
        return;
    }
    let mut trials: Vec<&TrialRow> = Vec::new();
    for own in distinct(row.protocols.iter().flatten()) {
        let Some(part) = edition.parts.iter().find(|part| part.is(own)) else { continue };
        let is_own = |trial: &&TrialRow| trial.key.preset == own.preset && trial.key.method == own.method;
        trials.extend(part.source.results.trials.iter().filter(is_own));
    }
    let undrawn = trials.iter().filter(|trial| trial.draws_nothing()).count();
    let noted = |kind: &str| trials.iter().filter(|own| own.notes.iter().any(|note| note.starts_with(kind))).count();
    let (broken, classic) = (noted(BROKEN), noted(DRAWN_CLASSIC));
    let all = trials.len();
    let mut parts = Vec::new();
    if undrawn > 0 {
        parts.push(format!("no Gaussian is drawn in {undrawn} of {all} trials, whose renders show the background"));
    }
    if broken > 0 {
        parts.push(format!("broken Gaussians were skipped or repaired in {broken} of {all} trials"));
    }
    if classic > 0 {
        let what = "Gaussians of antialiased training or with 3D filters were drawn in the classic mode";
        parts.push(format!("{what} in {classic} of {all} trials"));
    }
    if !parts.is_empty() {
        notes.add(NoteKind::Counts, format!("{}: {}; not left out of the mean", name(row), parts.join("; ")));
    }
}

fn intervals(notes: &mut Notes, table: &Table, row: &Row) {
    let mut groups: Vec<String> = Vec::new();
    for (group, own) in table.groups.iter().enumerate() {
        // Other columns print the interval in the cell.
        let cells = own.columns.iter().zip(&row.cells[group]).filter(|(column, _)| !column.intervals);
        let intervals: Vec<String> = cells
            .filter_map(|(column, cell)| {
                let (Value::Number(_), Some([low, high])) = (&cell.value, cell.interval) else { return None };
                let (low, high) = (column.format(low), column.format(high));
                Some(format!("{} {} [{low}, {high}]", column.title, cell.print(column)))
            })
            .collect();
        if !intervals.is_empty() {
            let title = if own.title.is_empty() { String::new() } else { format!("{}: ", own.title) };
            groups.push(format!("{title}{}", intervals.join(", ")));
        }
    }
    if !groups.is_empty() {
        let percent = CONFIDENCE * 100.0;
        notes.add(NoteKind::Interval, format!("{percent:.0} % over scenes, {}: {}", name(row), groups.join("; ")));
    }
}

pub(super) fn name(row: &Row) -> String {
    let labels = row.printed_labels();
    labels.iter().map(String::as_str).filter(|label| !label.is_empty()).collect::<Vec<_>>().join(", ")
}

/// The first 12 characters of a hash.
pub(crate) fn short(hash: &str) -> String {
    hash.chars().take(12).collect()
}

/// The first 12 characters of a commit, and the mark of uncommitted changes, if there is one.
pub(crate) fn short_commit(commit: &str) -> String {
    let changes = commit.split_once('+').map_or_else(String::new, |(_, changes)| format!("+{changes}"));
    short(commit) + &changes
}
