//! What plots show: the data of tables, stores and trials, of expansion studies, of the history of a baseline, of studies of
//! overlap estimators and of optimisation, and the frontiers of several stores. [`plot`](crate::plot) draws it.

mod drift;
mod estimators;
mod expansion;
mod frontier;
mod optimisation;
mod store;
mod subject;
mod table;
mod timed;
mod trial;
mod without_point;

pub use drift::drift_plot;
pub use estimators::estimator_scatter;
pub use expansion::expansion_plots;
pub use frontier::frontier_plots;
pub use optimisation::optimisation_section;
pub use store::store_plots;
pub(crate) use subject::title_of;
pub use table::table_plots;
pub use trial::trial_images;

use atsplat_metrics::{Definition, definitions};
use atsplat_results::{PresetRecord, Results};

/// The protocol's PSNR, as in tables; the first metric that its targets have scores of, if that was not scored.
pub(crate) fn first_metric(results: &Results, preset: &PresetRecord) -> Option<&'static Definition> {
    // A record that is no protocol is an error where more of it is read.
    let psnr = preset.protocol().ok().map(|protocol| protocol.metrics.psnr);
    let of_protocol = definitions().iter().filter(|metric| Some(metric.id) == psnr);
    let is_scored = |metric: &&Definition| {
        results.targets.iter().any(|row| row.key.preset == preset.name && row.scores.contains_key(metric.id))
    };
    of_protocol.chain(definitions()).find(is_scored)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{nearest_view, preset, results};

    #[test]
    fn plots_are_of_the_psnr_that_the_protocol_names_if_it_was_scored() {
        let mut store = results(vec![preset("re10k-overlap")], vec![nearest_view()]);
        let shown = |store: &Results| first_metric(store, &store.provenance.presets[0]).unwrap().id;
        assert_eq!(shown(&store), "psnr");
        let [usual, rounded] = ["psnr", "psnr-8bit-rounded"].map(|id| format!("[metrics]\npsnr = \"{id}\"\n"));
        let record = &mut store.provenance.presets[0];
        assert!(record.toml.contains(&usual), "{}", record.toml);
        record.toml = record.toml.replace(&usual, &rounded);
        assert_eq!(shown(&store), "psnr", "the other was not scored");
        for row in store.targets.iter_mut().filter(|row| row.scores.contains_key("psnr")) {
            row.scores.insert("psnr-8bit-rounded".to_owned(), 20.5);
        }
        assert_eq!(shown(&store), "psnr-8bit-rounded");
    }
}
