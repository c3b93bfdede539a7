//! One self-contained HTML page: no network, no server, no other files.

#[cfg(test)]
mod browser;
#[cfg(test)]
mod browser_tests;
mod cite;
mod facts;
mod film;
mod image_files;
mod images;
#[cfg(test)]
mod images_tests;
mod live;
#[cfg(test)]
mod live_tests;
mod protocols;
mod scenes;
mod tables;
#[cfg(test)]
mod tests;

use atsplat_results::Provenance;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

pub use film::Film;
pub use live::{LiveImage, LiveTrial};
pub use tables::table_html;

use crate::ReportError;
use crate::emit::TableFormat;
use crate::plot::Drawing;
use crate::plot::drawing::svg::escaped_except;
use crate::table::{Source, Table};
use image_files::ImageFiles;

/// The contents of a page.
#[derive(Debug)]
pub struct Page<'a> {
    /// Its title.
    pub title: String,
    /// Tables in order.
    pub tables: &'a [Table],
    /// Plots by name, in order.
    pub plots: &'a [(String, Drawing)],
    /// Further plots, each group under its own heading.
    pub sections: &'a [PlotSection],
    /// Trials of the live view.
    pub live: &'a [LiveTrial],
    /// The stores, each with its folder.
    pub stores: &'a [PageStore<'a>],
    /// Limit on the bytes of the page: images of trials are added until it is reached. If that leaves hardly any room to them, they
    /// take an eighth of the limit.
    pub max_bytes: usize,
}

/// Plots under their own heading.
#[derive(Clone, Debug)]
pub struct PlotSection {
    /// The heading.
    pub title: String,
    /// What the plots show, in a sentence.
    pub hint: String,
    /// Plots by name, in order.
    pub plots: Vec<(String, Drawing)>,
    /// Whether it comes before the tables.
    pub before_tables: bool,
    /// Stores that the plots are drawn from besides those of the page, by name.
    pub stores: Vec<(String, Provenance)>,
}

/// A store and its folder.
#[derive(Clone, Copy, Debug)]
pub struct PageStore<'a> {
    /// Its name and rows.
    pub source: Source<'a>,
    /// Its folder, whose `images` are shown; `None` for no images.
    pub folder: Option<&'a std::path::Path>,
}

/// Name of the page in a folder.
pub const FILE: &str = "index.html";
const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");
const LIVE: [&str; 3] = [include_str!("splatter.js"), include_str!("live.js"), include_str!("film.js")];

impl Page<'_> {
    /// The page as HTML.
    ///
    /// # Errors
    /// [`ReportError`] if a table or plot cannot be written; images that cannot be read are omitted and counted.
    pub fn write(&self) -> Result<String, ReportError> {
        self.write_with(None)
    }

    /// Like [`write`](Self::write), with an extra script at the end, for tests.
    pub(crate) fn write_with(&self, extra: Option<&str>) -> Result<String, ReportError> {
        let plots = [self.sections(true)?, figures(self.plots)?, self.sections(false)?, live::section(self.live)?];
        let mut files = ImageFiles::default();
        fitted(self.max_bytes, |budget| self.with_images(&mut files, budget, &plots, extra))
    }

    /// The page with at most `budget` bytes of trials' images, and how many bytes they have.
    fn with_images(
        &self,
        files: &mut ImageFiles,
        budget: usize,
        [leading, plots, sections, live]: &[String; 4],
        extra: Option<&str>,
    ) -> Result<(String, usize), ReportError> {
        let images = images::Album::fill(files, self.stores, budget);
        let uris = images.uris(files);
        let bytes = uris.iter().map(|uri| uri.len()).sum();
        let mut texts = serde_json::Map::new();
        for table in self.tables {
            let formats =
                [("latex", TableFormat::Latex), ("markdown", TableFormat::Markdown), ("csv", TableFormat::Csv)];
            let written =
                formats.map(|(name, format)| format.write(table).map(|text| (name.to_owned(), Value::String(text))));
            texts.insert(table.name.clone(), Value::Object(written.into_iter().collect::<Result<_, _>>()?));
        }
        let data = json!({
            "texts": texts,
            "metrics": scenes::metrics(self.stores),
            "runs": scenes::runs(self.stores, &images),
            "images": uris,
            "live": live::data(self.live),
        });
        let of_live: &[&str] = if self.live.is_empty() { &[] } else { &LIVE };
        let scripts: Vec<&str> = std::iter::once(SCRIPT).chain(of_live.iter().copied()).chain(extra).collect();
        let hashes: Vec<String> = scripts.iter().copied().map(hash_of).collect();
        let slots = [
            ("hashes", hashes.join(" ")),
            ("style", STYLE.to_owned()),
            ("title", escaped(&self.title)),
            ("summary", facts::summary(self.tables, self.stores)),
            ("protocols", protocols::write(self.tables, self.stores)),
            ("tables", tables::write(self.tables, self.stores)),
            ("leading", leading.clone()),
            ("plots", plots.clone()),
            ("sections", sections.clone()),
            ("live", live.clone()),
            ("leading-links", self.links(true)),
            ("links", self.links(false)),
            ("contents", self.contents()),
            ("scenes", scenes::section(self.stores, &images)),
            ("origin", facts::origin(self.provenances())),
            ("data", safe_json(&data)?),
            ("scripts", scripts.iter().map(|script| format!("<script>{script}</script>\n")).collect()),
        ];
        Ok((filled(PAGE, &slots), bytes))
    }

    /// The provenance of the page's stores, then of those that only sections show.
    fn provenances(&self) -> impl Iterator<Item = (&str, &Provenance)> {
        let of_page = self.stores.iter().map(|store| (store.source.label, &store.source.results.provenance));
        let of_sections = self.sections.iter().flat_map(|section| &section.stores);
        of_page.chain(of_sections.map(|(label, provenance)| (label.as_str(), provenance)))
    }

    /// The sections with plots before the tables, or those after them.
    fn shown(&self, before: bool) -> impl Iterator<Item = (usize, &PlotSection)> {
        self.sections
            .iter()
            .enumerate()
            .filter(move |(_, section)| section.before_tables == before && !section.plots.is_empty())
    }

    fn sections(&self, before: bool) -> Result<String, ReportError> {
        let section = |(at, PlotSection { title, hint, plots, .. }): (usize, &PlotSection)| {
            let (title, hint, figures) = (escaped(title), escaped(hint), figures(plots)?);
            Ok(format!(
                "<section id=\"section-{at}\" aria-labelledby=\"section-{at}-head\">\n  <h2 id=\"section-{at}-head\">{title}</h2>\n  \
                 <p class=\"hint\">{hint}</p>\n  {figures}\n</section>\n"
            ))
        };
        self.shown(before).map(section).collect()
    }

    /// Contents of the printed page.
    fn contents(&self) -> String {
        let item = |name: &str, title: &str| format!("<li><a href=\"#{name}\">{}</a></li>", escaped(title));
        let tables = self.tables.iter().map(|table| item(&format!("table-{}", table.name), &table.title));
        let plots = self.plots.iter().map(|(name, drawing)| {
            let heading: Vec<&str> = drawing.texts().take(2).collect();
            item(&format!("plot-{name}"), &heading.join(": "))
        });
        let sections = |before| {
            self.shown(before).map(|(at, section)| item(&format!("section-{at}"), &section.title)).collect::<Vec<_>>()
        };
        let live = (!self.live.is_empty()).then(|| item("live", "Trials in images"));
        let items: String = sections(true)
            .into_iter()
            .chain(tables)
            .chain(plots)
            .chain(sections(false))
            .chain(live)
            .chain([item("origin", "Provenance")])
            .collect();
        format!("<nav class=\"contents\" aria-label=\"Contents\"><h2>Contents</h2><ol>{items}</ol></nav>")
    }

    /// Links to the sections on one side of the tables, and to the live view.
    fn links(&self, before: bool) -> String {
        let link = |name: &str, title: &str| format!("<a href=\"#{name}\">{title}</a>\n      ");
        let sections = self.shown(before).map(|(at, section)| link(&format!("section-{at}"), &escaped(&section.title)));
        sections.chain((!before && !self.live.is_empty()).then(|| link("live", "Live view"))).collect()
    }
}

/// A page of at most `limit` bytes, or a larger one if it leaves hardly any room for images: then those of the worst, best and typical
/// trials take at most an eighth of the limit. `write` gets a budget for images, and returns the page and the bytes that its images take.
fn fitted<E>(limit: usize, mut write: impl FnMut(usize) -> Result<(String, usize), E>) -> Result<String, E> {
    let reserve = limit / 8;
    let mut budget = limit;
    loop {
        let (page, images) = write(budget)?;
        let without = page.len().saturating_sub(images);
        // Less than the images took: with less than the budget alone, the same images might fit again.
        let room = limit.saturating_sub(without);
        let has_room = room >= images.min(reserve) / 4;
        if page.len() <= limit || images == 0 || (!has_room && images <= reserve) {
            return Ok(page);
        }
        budget = if has_room { room } else { reserve };
    }
}

fn figures(plots: &[(String, Drawing)]) -> Result<String, ReportError> {
    if plots.is_empty() {
        return Ok("<p class=\"hint\">These results have nothing to plot.</p>".to_owned());
    }
    let mut text = String::from("<div class=\"plots\">\n");
    for (name, drawing) in plots {
        let svg = drawing.to_svg()?;
        let heading: Vec<&str> = drawing.texts().take(2).collect();
        let labelled = format!("<svg role=\"img\" aria-label=\"{}\" ", escaped(&heading.join(". ")));
        text.push_str(&format!(
            "<figure id=\"plot-{}\">{}</figure>\n",
            escaped(name),
            svg.replacen("<svg ", &labelled, 1)
        ));
    }
    text.push_str("</div>");
    Ok(text)
}

/// Fills the slots of the page in one pass; inserted text is not searched for slots.
fn filled(page: &str, slots: &[(&str, String)]) -> String {
    let mut text = String::with_capacity(page.len() + slots.iter().map(|(_, content)| content.len()).sum::<usize>());
    let mut rest = page;
    while let Some((before, after)) = rest.split_once("{{") {
        text.push_str(before);
        let Some((name, behind)) = after.split_once("}}") else {
            text.push_str("{{");
            rest = after;
            break;
        };
        if let Some((_, content)) = slots.iter().find(|(known, _)| *known == name) {
            text.push_str(content);
        }
        rest = behind;
    }
    text.push_str(rest);
    text
}

/// Escapes text for HTML, in elements and in attributes with either kind of quote.
fn escaped(text: &str) -> String {
    escaped_except(text, &['\t', '\n', '\r']).replace('\'', "&#39;")
}

/// JSON that is safe inside a script element.
fn safe_json(value: &Value) -> Result<String, ReportError> {
    let text = serde_json::to_string(value)?;
    Ok(text
        .replace('<', "\\u003c")
        .replace('>', "\\u003e")
        .replace('&', "\\u0026")
        .replace('\u{2028}', "\\u2028")
        .replace('\u{2029}', "\\u2029"))
}

/// The hash by which the page's content security policy allows a script.
fn hash_of(script: &str) -> String {
    format!("'sha256-{}'", STANDARD.encode(Sha256::digest(script.as_bytes())))
}
