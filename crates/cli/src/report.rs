//! `atsplat report`: writes tables, plots and an HTML page of results stores.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use atsplat_report::definition::{Choice, Quantity, TableDefinition};
use atsplat_report::emit::{TableFormat, Terminal, json_of};
use atsplat_report::page::PageStore;
use atsplat_report::table::{Mixing, NoteKind, Source, agreement};
use atsplat_report::{PAGE_MEGABYTES, Report, ReportError, Request, Written, counted, store_labels};
use atsplat_results::Results;
use serde_json::json;

use crate::objects::CacheArgs;
use crate::output_lock::OutputLock;
use crate::parse::{named, once, usage_error};
use crate::print::{note, print_json, print_status, print_text, warn};
use crate::run::merge::reject_duplicates;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folders of results of `atsplat run`, complete or not, or URLs (s3://, gs://, az://).
    #[arg(value_name = "STORE", required = true)]
    stores: Vec<PathBuf>,

    /// Folder for `tables/`, `plots/` and `index.html`; the files of an earlier report there are replaced.
    #[arg(long, short, value_name = "DIR", default_value = "reports/latest")]
    out: PathBuf,

    /// Which of the paper's tables; by default all for which the stores have results, and one for every protocol.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = table_name)]
    tables: Vec<String>,

    #[command(flatten)]
    choice: ChoiceArgs,

    /// Formats of the tables.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values = ["markdown", "latex", "csv", "json", "terminal"], value_parser = named(FORMATS))]
    format: Vec<TableFormat>,

    /// Put results of different protocols into one table, which is then marked.
    #[arg(long)]
    force: bool,

    /// Title of the page.
    #[arg(long, value_name = "TEXT", default_value = TITLE)]
    title: String,

    #[command(flatten)]
    page: PageArgs,

    /// Check every plot: texts that are cut off or cover something, colours, legends, axes, intervals, headings. Faults are
    /// printed; after everything is written, the command exits with 1.
    #[arg(long)]
    check_plots: bool,

    #[command(flatten)]
    cache: CacheArgs,

    /// Print the tables as JSON.
    #[arg(long)]
    json: bool,
}

/// What tables show.
#[derive(Debug, clap::Args)]
struct ChoiceArgs {
    /// Columns of the tables and their order: metrics as in --metrics, gaussians, seconds, and so on; by default all.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    columns: Vec<Quantity>,

    /// Methods of the tables and their order, as tables name them; by default all. Rows that reproduce one of the paper's stay
    /// below it.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    methods: Vec<String>,

    /// Leave out the paper's rows.
    #[arg(long)]
    no_published: bool,

    /// Add the paired difference of every measured row to this method, with its 95 % interval: of the first metric, or of all
    /// metrics of --columns. The method may be in another store, on the same data; STORE: NAME tells methods of one name apart.
    #[arg(long, value_name = "METHOD")]
    against: Option<String>,

    /// Decimals of measured metrics and seconds, such as psnr=3,ssim=4; by default 2 for decibels and 3 for the others, as papers print
    /// them. The paper's own numbers keep theirs.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = decimals)]
    decimals: Vec<(Quantity, usize)>,
}

impl ChoiceArgs {
    /// Rejects repeated values.
    fn check(&self) -> Result<(), String> {
        let columns: Vec<String> = self.columns.iter().map(|column| column.id().to_owned()).collect();
        let of_decimals: Vec<String> = self.decimals.iter().map(|(column, _)| column.id().to_owned()).collect();
        once("--columns", &columns)?;
        once("--decimals", &of_decimals)?;
        once("--methods", &self.methods)
    }

    fn choice(&self) -> Choice {
        Choice {
            columns: self.columns.clone(),
            methods: self.methods.clone(),
            without_published: self.no_published,
            against: self.against.clone(),
            decimals: self.decimals.clone(),
        }
    }

    /// What it adds to a message about missing results.
    const fn in_words(&self) -> &'static str {
        if self.columns.is_empty() && self.methods.is_empty() { "" } else { " in the chosen columns and methods" }
    }

    fn warn_of_absent_columns(&self, report: &Report) {
        let columns = || report.tables.iter().flat_map(|table| table.columns().map(|(_, column)| column.quantity));
        let of_columns = self.columns.iter().map(|wanted| ("--columns", wanted));
        let wanted = of_columns.chain(self.decimals.iter().map(|(wanted, _)| ("--decimals", wanted)));
        for (option, absent) in wanted.filter(|(_, wanted)| columns().all(|shown| shown != **wanted)) {
            warn(&format!("{option}: no table has {}", absent.id()));
        }
    }
}

/// Default title of the page.
pub(crate) const TITLE: &str = "Measured results next to the paper's";

/// The HTML page of a report.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct PageArgs {
    /// Size of the page in megabytes; what tables, plots and the list of trials leave of it is filled with images of trials, the
    /// worst, typical and best first. If they leave hardly any room, images take an eighth of this size, and a warning says that the page
    /// is larger.
    #[arg(long = "page-size", value_name = "MB", default_value_t = PAGE_MEGABYTES)]
    megabytes: u16,
}

impl PageArgs {
    pub(crate) fn max_bytes(self) -> usize {
        usize::from(self.megabytes) * 1_000_000
    }

    /// Warns of a page that is larger than requested: it has hardly any room for images.
    pub(crate) fn warn_of_size(self, report: &Report) {
        let found = report.page_bytes();
        if found > self.max_bytes() {
            let (found, allowed) = (found as f64 / 1e6, self.megabytes);
            warn(&format!(
                "the page has {found:.1} MB, more than --page-size {allowed}: tables, plots and the list of trials leave \
                 hardly any room for images, or none"
            ));
        }
    }
}

const FORMATS: [(&str, TableFormat); 5] = [
    ("terminal", TableFormat::Terminal),
    ("markdown", TableFormat::Markdown),
    ("latex", TableFormat::Latex),
    ("csv", TableFormat::Csv),
    ("json", TableFormat::Json),
];

/// `psnr=3`: a metric or seconds, with the decimals of its numbers.
fn decimals(text: &str) -> Result<(Quantity, usize), String> {
    const MAX: usize = 9;
    let Some((quantity, decimals)) = text.split_once('=') else {
        return Err(format!("expected COLUMN=DECIMALS, such as psnr=3, found {text:?}"));
    };
    let quantity: Quantity = quantity.parse()?;
    if !matches!(quantity, Quantity::Metric(_) | Quantity::Seconds) {
        return Err(format!("expected a metric or seconds, found {}, which has no decimals", quantity.id()));
    }
    match decimals.parse::<usize>() {
        Ok(count) if count <= MAX => Ok((quantity, count)),
        _ => Err(format!("expected 0 to {MAX} decimals, found {decimals:?}")),
    }
}

fn table_name(text: &str) -> Result<String, String> {
    match TableDefinition::names().find(|name| *name == text) {
        Some(name) => Ok(name.to_owned()),
        None => Err(format!("expected one of {}", TableDefinition::names().collect::<Vec<_>>().join(", "))),
    }
}

/// Writes the report and prints its tables; `false` if a requested table has no results or a store lacks something. A checked
/// plot with a fault is an error, when everything is written.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    args.check()?;
    let labels = store_labels(&args.stores);
    let folders = args.stores.iter().map(|store| args.cache.store(store)).collect::<anyhow::Result<Vec<PathBuf>>>()?;
    let read = folders.iter().zip(Results::read_each(&folders));
    let results = read.map(|(path, results)| results.with_context(|| format!("reading {}", path.display())));
    let results = results.collect::<anyhow::Result<Vec<Results>>>()?;
    let lock = OutputLock::of(&args.out)?;
    let stores: Vec<PageStore<'_>> = results
        .iter()
        .zip(&labels)
        .zip(&folders)
        .map(|((results, label), folder)| PageStore { source: Source { label, results }, folder: Some(folder) })
        .collect();
    let report = args.report(&stores, &labels)?;
    let Written { files, removed, others } = report.replace(lock.folder_lock())?;
    args.page.warn_of_size(&report);
    if args.json {
        let tables: Vec<_> = report.tables.iter().map(json_of).collect();
        let unmeasured = &report.unmeasured;
        let written = json!({ "tables": tables, "unmeasured": unmeasured, "files": files, "removed": removed });
        print_json(&written)?;
    } else {
        print_tables(&report)?;
        let (files, folder, page) = (counted(files.len() as u64, "file"), &args.out, args.out.join("index.html"));
        print_status(&format!("{files} in {}, the page is {}", folder.display(), page.display()));
    }
    report_other_files(&args.out, &removed, &others);
    let forced = report.tables.iter().flat_map(|table| &table.footer).any(|remark| remark.kind == NoteKind::Forced);
    if args.force && !forced {
        note("--force has no effect: no table mixes results that do not belong together");
    }
    let missing = if args.tables.is_empty() { &[][..] } else { &report.unmeasured };
    for name in missing {
        warn(&format!("the stores have no results for table {name}{}", args.choice.in_words()));
    }
    args.choice.warn_of_absent_columns(&report);
    warn_of_absent_glyphs(&report);
    let mut complete = missing.is_empty();
    for (store, label) in results.iter().zip(&labels) {
        for gap in store.gaps() {
            warn(&format!("{label}: {gap}"));
            complete = false;
        }
    }
    if args.check_plots {
        check_plots(&report, &args.out)?;
    }
    Ok(complete)
}

impl Args {
    /// Rejects repeated values before anything is read.
    fn check(&self) -> anyhow::Result<()> {
        once("--tables", &self.tables).map_err(usage_error)?;
        self.choice.check().map_err(usage_error)?;
        let name_of = |given: &TableFormat| FORMATS.iter().find(|(_, format)| format == given).map(|(name, _)| *name);
        let formats: Vec<String> = self.format.iter().filter_map(name_of).map(str::to_owned).collect();
        once("--format", &formats).map_err(usage_error)?;
        reject_duplicates(&self.stores)
    }

    /// The report, which has a table.
    fn report(&self, stores: &[PageStore<'_>], labels: &[String]) -> anyhow::Result<Report> {
        let report = Report::new(&self.request(), stores).map_err(|error| match error {
            ReportError::Method { .. } => anyhow::Error::from(usage_error(format!("--{error}"))),
            error => error.into(),
        })?;
        if report.tables.is_empty() {
            let (tables, chosen) = (self.tables.join(", "), self.choice.in_words());
            let none = "the stores have no results";
            ensure!(self.tables.is_empty(), "--tables: {none} for any of these tables{chosen}: {tables}");
            bail!("{none}{chosen}: {}", labels.join(", "));
        }
        Ok(report)
    }

    fn request(&self) -> Request {
        let tables = if self.tables.is_empty() {
            TableDefinition::names().map(str::to_owned).collect()
        } else {
            self.tables.clone()
        };
        Request {
            title: self.title.clone(),
            tables,
            protocols: self.tables.is_empty(),
            formats: self.format.clone(),
            mixing: if self.force { Mixing::Forced } else { Mixing::Apart },
            choice: self.choice.choice(),
            max_bytes: self.page.max_bytes(),
            sections: Vec::new(),
            live: Vec::new(),
        }
    }
}

/// Warns of characters that PNG plots cannot show.
fn warn_of_absent_glyphs(report: &Report) {
    let absent = report.without_glyph();
    if absent.is_empty() {
        return;
    }
    let absent: Vec<String> = absent.iter().map(|(letter, text)| format!("{letter} (“{text}”)")).collect();
    warn(&format!("PNG plots have boxes in place of characters that their font lacks: {}", absent.join(", ")));
}

/// Warns of the faults of plots; any is an error.
fn check_plots(report: &Report, folder: &Path) -> anyhow::Result<()> {
    let faults = report.plot_faults();
    for (plot, fault) in &faults {
        warn(&format!("plot {plot}: {fault}"));
    }
    let found = counted(faults.len() as u64, "fault");
    print_status(&format!("{} checked, {found}", counted(report.plots.len() as u64, "plot")));
    ensure!(faults.is_empty(), "--check-plots: {found} in the plots of {}", folder.display());
    Ok(())
}

/// Reports which files of an earlier report were removed, and that others stay.
pub(crate) fn report_other_files(folder: &Path, removed: &[PathBuf], others: &[PathBuf]) {
    let folder = folder.display();
    if !removed.is_empty() {
        print_status(&format!("{} of an earlier report removed from {folder}", counted(removed.len() as u64, "file")));
    }
    if let Some(first) = others.first() {
        let (others, first) = (counted(others.len() as u64, "file"), first.display());
        warn(&format!("{folder} contains {others} that this report did not write, such as {first}"));
    }
}

fn print_tables(report: &Report) -> anyhow::Result<()> {
    let terminal = terminal();
    for table in &report.tables {
        print_text(&format!("{}\n", terminal.write(table)))?;
    }
    for table in report.tables.iter().filter(|table| table.is_published()) {
        print_text(&format!("{}: {}\n", table.title, agreement(table)))?;
    }
    Ok(())
}

/// The format of the terminal: its width, and bold and underlined numbers unless `NO_COLOR` is set.
fn terminal() -> Terminal {
    const DEFAULT_WIDTH: usize = 120;
    const MIN_WIDTH: u16 = 40;
    let is_terminal = std::io::stdout().is_terminal();
    let plain = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let width =
        terminal_size::terminal_size().filter(|_| is_terminal).map(|(width, _)| usize::from(width.0.max(MIN_WIDTH)));
    Terminal { width: width.unwrap_or(DEFAULT_WIDTH), styled: is_terminal && !plain }
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::Cli;

    #[test]
    fn unknown_columns_are_usage_errors() {
        let code = |columns: &str| {
            let parsed = Cli::try_parse_from(["atsplat", "report", "store", "--columns", columns]);
            parsed.map(drop).map_err(|error| error.exit_code())
        };
        assert_eq!((code("psnr,gaussians"), code("psnr,psmr")), (Ok(()), Err(2)));
    }

    #[test]
    fn decimals_are_of_metrics_and_seconds() {
        let parse = |text: &str| decimals(text).map(|(quantity, decimals)| (quantity.id(), decimals));
        assert_eq!((parse("psnr=3"), parse("seconds=0")), (Ok(("psnr", 3)), Ok(("seconds", 0))));
        for (wrong, expected) in [
            ("psnr", "such as psnr=3"),
            ("psmr=3", "psnr, "),
            ("gaussians=1", "expected a metric or seconds"),
            ("ssim=10", "expected 0 to 9 decimals, found \"10\""),
            ("ssim=-1", "found \"-1\""),
        ] {
            let error = parse(wrong).unwrap_err();
            assert!(error.contains(expected), "{wrong}: {error}");
        }
        let given = vec![decimals("psnr=3").unwrap(), decimals("PSNR=4").unwrap()];
        let (columns, methods) = (Vec::new(), Vec::new());
        let choice = ChoiceArgs { columns, methods, no_published: false, against: None, decimals: given };
        assert_eq!(choice.check(), Err("--decimals: psnr is given twice".to_owned()));
    }

    #[test]
    fn parses_table_names() {
        assert_eq!(table_name("re10k").as_deref(), Ok("re10k"));
        assert!(table_name("re20k").unwrap_err().contains("re10k_overlap"));
    }
}
