use std::path::{Path, PathBuf};

use crate::definition::TableDefinition;
use crate::emit::{TableFormat, orders_as_markdown};
use crate::figures::{of_frontier, of_store, of_table, optimisation_section};
use crate::file_names::unused;
use crate::page::{Film, LiveTrial, Page, PageStore, PlotSection};
use crate::plot::{Drawing, PlotFault, PlotFormat};
use crate::table::{Mixing, Source, Table, protocol_tables, tables};
use crate::written::{FileList, Writing, Written};
use crate::{ReportError, page};

/// What a report contains.
#[derive(Clone, Debug)]
pub struct Request {
    /// Title of the page.
    pub title: String,
    /// Names of tables; tables without measured rows are omitted.
    pub tables: Vec<String>,
    /// Whether every protocol gets a table of its own too.
    pub protocols: bool,
    /// File formats of tables.
    pub formats: Vec<TableFormat>,
    /// Whether a table may mix protocols.
    pub mixing: Mixing,
    /// Limit on the bytes of the page.
    pub max_bytes: usize,
    /// Plots from sources other than stores.
    pub sections: Vec<PlotSection>,
    /// Trials of the page's live view.
    pub live: Vec<LiveTrial>,
}

/// A report, ready to be written.
#[derive(Debug)]
pub struct Report {
    /// Tables with measured rows, in order.
    pub tables: Vec<Table>,
    /// Names of the requested tables without measured rows.
    pub unmeasured: Vec<String>,
    /// Plots by name, with those of sections last.
    pub plots: Vec<(String, Drawing)>,
    films: Vec<Film>,
    html: String,
    formats: Vec<TableFormat>,
}

impl Report {
    /// Makes tables, plots and the page from stores.
    ///
    /// # Errors
    /// [`ReportError::UnknownTable`], and the errors of tables, plots and pages.
    pub fn new(request: &Request, stores: &[PageStore<'_>]) -> Result<Self, ReportError> {
        let sources: Vec<Source<'_>> = stores.iter().map(|store| store.source).collect();
        let (mut measured, mut unmeasured) = (Vec::new(), Vec::new());
        let mut plots = of_frontier(&sources)?;
        let cost = cost_section(&mut plots);
        for name in &request.tables {
            let definition = TableDefinition::named(name)?;
            for table in tables(&definition, &sources, request.mixing)? {
                if table.is_measured() {
                    plots.extend(of_table(&definition, &table, &sources));
                    measured.push(table);
                } else {
                    unmeasured.push(table.name);
                }
            }
        }
        if request.protocols {
            measured.extend(protocol_tables(&sources, request.mixing)?);
        }
        for source in &sources {
            for (name, plot) in of_store(source)? {
                // Different labels may give the same name.
                let name = unused(&name, |name| plots.iter().any(|(own, _)| own == name));
                plots.push((name, plot));
            }
        }
        let sections: Vec<PlotSection> =
            cost.into_iter().chain(optimisation_section(&sources)?).chain(request.sections.iter().cloned()).collect();
        let title = request.title.clone();
        let (live, max_bytes) = (request.live.as_slice(), request.max_bytes);
        let page = Page { title, tables: &measured, plots: &plots, sections: &sections, live, stores, max_bytes };
        let html = page.write()?;
        plots.extend(sections.into_iter().flat_map(|section| section.plots));
        let films = request.live.iter().filter_map(|trial| trial.film.clone()).collect();
        Ok(Self { films, tables: measured, unmeasured, plots, html, formats: request.formats.clone() })
    }

    /// What is wrong with the plots, each with its plot's name; empty for a good report.
    pub fn plot_faults(&self) -> Vec<(&str, PlotFault)> {
        self.plots
            .iter()
            .flat_map(|(name, plot)| plot.faults().into_iter().map(move |own| (name.as_str(), own)))
            .collect()
    }

    /// Bytes of the page.
    pub const fn page_bytes(&self) -> usize {
        self.html.len()
    }

    /// As [`Self::replace`]; returns the paths of all files.
    ///
    /// # Errors
    /// Those of [`Self::replace`].
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
        self.replace(folder).map(|written| written.files)
    }

    /// Writes `tables/`, `orders.md`, `plots/`, `films/` and `index.html` into a folder, creating it if necessary, and a list of
    /// these files with their hashes. Then removes the files of the report that was there before, as its list names them: not
    /// those that were changed since, and no others.
    ///
    /// # Errors
    /// Before anything is written, [`ReportError::NotOfReport`] if one of the files is there already and no report wrote it, or it
    /// was changed since, and [`ReportError::Io`] for a broken list; then [`ReportError::Io`] and the errors of tables and plots.
    pub fn replace(&self, folder: &Path) -> Result<Written, ReportError> {
        let orders = orders_as_markdown(&self.tables);
        let mut writing = Writing::new(folder, FileList::read(folder)?, &self.file_names(orders.is_some()))?;
        for table in &self.tables {
            for format in &self.formats {
                writing.write(table_name(table, *format), format.write(table)?.as_bytes())?;
            }
        }
        if let Some(orders) = orders {
            writing.write(ORDERS.to_owned(), orders.as_bytes())?;
        }
        for (name, drawing) in &self.plots {
            for format in PLOT_FORMATS {
                writing.write(plot_name(name, format), &drawing.encode(format)?)?;
            }
        }
        for film in &self.films {
            writing.write(film_name(&film.name), &film.animated_png()?)?;
        }
        writing.write(page::FILE.to_owned(), self.html.as_bytes())?;
        writing.finish()
    }

    /// The files that [`Self::replace`] writes.
    fn file_names(&self, has_orders: bool) -> Vec<String> {
        let formats = |table| self.formats.iter().map(move |format| table_name(table, *format));
        let mut names: Vec<String> = self.tables.iter().flat_map(formats).collect();
        names.push(page::FILE.to_owned());
        names.extend(has_orders.then(|| ORDERS.to_owned()));
        names.extend(self.plots.iter().flat_map(|(name, _)| PLOT_FORMATS.map(|format| plot_name(name, format))));
        names.extend(self.films.iter().map(|film| film_name(&film.name)));
        names
    }
}

/// The published orders of all tables.
const ORDERS: &str = "orders.md";
const PLOT_FORMATS: [PlotFormat; 2] = [PlotFormat::Svg, PlotFormat::Png];

fn table_name(table: &Table, format: TableFormat) -> String {
    format!("tables/{}.{}", table.name, format.extension())
}

fn plot_name(name: &str, format: PlotFormat) -> String {
    format!("plots/{name}.{}", format.extension())
}

fn film_name(name: &str) -> String {
    format!("films/{name}.png")
}

/// What a report begins with: the first frontier, which is taken out of the plots.
fn cost_section(frontiers: &mut Vec<(String, Drawing)>) -> Option<PlotSection> {
    if frontiers.is_empty() {
        return None;
    }
    let hint = match frontiers.len() {
        1 => "What each method takes for its quality, in seconds and in Gaussians.",
        _ => {
            "What each method takes for its quality, in seconds and in Gaussians; other protocols are among the plots below."
        }
    };
    Some(PlotSection {
        title: "What accuracy costs".to_owned(),
        hint: hint.to_owned(),
        plots: vec![frontiers.remove(0)],
        before_tables: true,
    })
}

/// Labels of stores, all different: the folder's name, with a number if several have the same.
pub fn store_labels(stores: &[PathBuf]) -> Vec<String> {
    let names: Vec<String> = stores.iter().map(|path| atsplat_files::name_of(path)).collect();
    let mut labels: Vec<String> = Vec::new();
    for (at, own) in names.iter().enumerate() {
        let twins = names.iter().filter(|other| *other == own).count();
        let label = if twins > 1 { format!("{own} ({})", at + 1) } else { own.clone() };
        // A folder may have the name that another label got.
        let label = unused(&label, |label| labels.iter().any(|other| other == label));
        labels.push(label);
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{atsplat, floor, preset, results};

    #[test]
    fn stores_of_the_same_name_get_distinct_labels() {
        let stores = ["a/run", "b/run", "c/other"].map(PathBuf::from);
        assert_eq!(store_labels(&stores), ["run (1)", "run (2)", "other"]);
        let stores = ["a/run", "b/run", "c/run (1)"].map(PathBuf::from);
        assert_eq!(store_labels(&stores), ["run (1)", "run (2)", "run (1)-2"]);
    }

    /// Both labels are `a-b` in file names.
    #[test]
    fn every_plot_has_a_file_of_its_own() {
        let results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), floor()]);
        let request = Request {
            title: String::new(),
            tables: Vec::new(),
            protocols: false,
            formats: Vec::new(),
            mixing: Mixing::Apart,
            max_bytes: 0,
            sections: Vec::new(),
            live: Vec::new(),
        };
        let store = |label| PageStore { source: Source { label, results: &results }, folder: None };
        let report = Report::new(&request, &[store("a b"), store("a-b")]).unwrap();
        let names: Vec<&String> = report.plots.iter().map(|(name, _)| name).collect();
        assert!(names.iter().any(|name| name.as_str() == "a-b-re10k-2v-256-time-2"), "{names:?}");
        assert_eq!(names.len(), names.iter().collect::<std::collections::BTreeSet<_>>().len(), "{names:?}");
    }
}
