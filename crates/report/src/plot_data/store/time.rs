use std::collections::BTreeMap;

use atsplat_results::MethodRecord;
use atsplat_results::times::{GAUSSIANS_UNTIMED, Times, machine_of, times};

use super::ProtocolResults;
use crate::plot::{Drawing, StageTime, StageTimeRow};
use crate::plot_data::timed::Timed;
use crate::table::BUSY;

/// A part of the encoding below this share of it is a sliver that nobody sees, but the legend would name.
const VISIBLE: f64 = 1e-3;

impl ProtocolResults<'_> {
    /// The times of the timing pass, with a reason for each method without times; `None` without a timing pass: a time that was stated
    /// has neither stages nor quartiles.
    pub(super) fn time(&self) -> Option<Drawing> {
        machine_of(self.results, &self.preset.name).filter(|machine| !machine.is_stated())?;
        let mut timed = Timed::default();
        let row = |method: &MethodRecord| {
            let times = times(self.results, &self.preset.name, &method.name);
            if let Ok(Times { machine, device, busy, trials, trials_there, .. }) = &times {
                timed.add(&self.title(method), machine, device.as_deref());
                timed.trials(&self.title(method), [*trials, *trials_there]);
                timed.mark(None, *busy);
            }
            stage_time_row(self.title(method), method.is_process(), times)
        };
        let rows: Vec<StageTimeRow> = self.methods().map(row).collect();
        let plot = StageTime {
            title: "Where the time goes until the first image".to_owned(),
            subtitle: format!("{}; medians and quartiles, averaged over trials{}", self.subject(), timed.in_words()),
            rows,
        };
        (!plot.rows.is_empty()).then(|| plot.draw())
    }
}

/// The stages of a process are those that it states. What else an encoding takes is shown as the rest of it.
fn stage_time_row(label: String, is_process: bool, times: Result<Times, String>) -> StageTimeRow {
    let times = match times {
        Ok(times) => times,
        Err(reason) => {
            return StageTimeRow { label, stages: Vec::new(), total: None, spread: None, untimed: Some(reason) };
        }
    };
    if times.first_image.is_none() && times.render.is_some() {
        let untimed = Some(GAUSSIANS_UNTIMED.to_owned());
        return StageTimeRow { label, stages: Vec::new(), total: None, spread: None, untimed };
    }
    let mut stages: Vec<(String, f64)> =
        in_order(&times.stages).into_iter().map(|(name, spread)| (name.clone(), spread.median)).collect();
    if let Some(encode) = times.encode {
        let rest = encode.median - stages.iter().map(|(_, secs)| secs).sum::<f64>();
        let name = match (is_process, stages.is_empty()) {
            (true, true) => "the whole answer",
            (true, false) => "the rest of the answer",
            (false, true) => "encode",
            (false, false) => "between the stages",
        };
        stages.extend((rest > VISIBLE * encode.median).then(|| (name.to_owned(), rest)));
    }
    stages.extend(times.render.map(|spread| ("render a view".to_owned(), spread.median)));
    StageTimeRow {
        label: if times.busy { format!("{label} {BUSY}") } else { label },
        untimed: stages.is_empty().then(|| "no stage was timed".to_owned()),
        stages,
        total: times.first_image.map(|spread| spread.median),
        spread: times.quartiles(),
    }
}

/// The network's stages in the order in which they run; a store keeps them sorted by name.
fn in_order<T>(stages: &BTreeMap<String, T>) -> Vec<(&String, &T)> {
    const ORDER: [&str; 5] = ["coarse", "anchors", "fine", "decoder", "head"];
    let mut stages: Vec<_> = stages.iter().collect();
    stages.sort_by_key(|(name, _)| ORDER.iter().position(|known| known == name).unwrap_or(ORDER.len()));
    stages
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use atsplat_results::{Results, StatedCost, StatedSeconds};

    use super::*;
    use crate::plot_data::store_plots;
    use crate::sample::{atsplat, nearest_view, preset, results};
    use crate::table::Source;

    /// One method with encodings of 0.26 s, of which these stages are known.
    fn with_stages(stated: &[(&str, f64)]) -> Results {
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ())]);
        for row in &mut results.timings {
            row.stages = stated.iter().map(|(name, secs)| ((*name).to_owned(), vec![*secs; 5])).collect();
        }
        results
    }

    fn texts(results: &Results) -> String {
        let plots = store_plots(&Source { label: "run", results }).unwrap();
        let (_, plot) = plots.iter().find(|(name, _)| name == "run-re10k-2v-256-time").unwrap();
        assert_eq!(plot.faults(), []);
        plot.texts().collect::<Vec<_>>().join("\n")
    }

    /// Rendering takes 0.005 s.
    #[test]
    fn a_bar_is_as_long_as_the_time_to_the_first_image() {
        let row = |is_process, stated: &[(&str, f64)]| {
            let times = times(&with_stages(stated), "re10k-2v-256", "atsplat");
            let row = stage_time_row(String::new(), is_process, times);
            Tolerance::F64.assert(row.total, [0.265], "encoding and rendering");
            let (names, secs): (Vec<String>, Vec<f64>) = row.stages.into_iter().unzip();
            (names.join(", "), secs)
        };
        let (names, secs) = row(true, &[]);
        assert_eq!(names, "the whole answer, render a view");
        Tolerance::F64.assert(secs, [0.26, 0.005], "an answer without stages");
        let (names, secs) = row(true, &[("encode", 0.005)]);
        assert_eq!(names, "encode, the rest of the answer, render a view");
        Tolerance::F64.assert(secs, [0.005, 0.255, 0.005], "an answer with its encoder");
        let (names, secs) = row(false, &[("coarse", 0.2)]);
        assert_eq!(names, "coarse, between the stages, render a view");
        Tolerance::F64.assert(secs, [0.2, 0.06, 0.005], "a method within this process");
        let (names, secs) = row(false, &[("coarse", 0.06), ("head", 0.2)]);
        assert_eq!(names, "coarse, head, render a view");
        Tolerance::F64.assert(secs, [0.06, 0.2, 0.005], "without a rest");
    }

    /// What takes the time until their first image is not known.
    #[test]
    fn gaussians_that_were_made_elsewhere_have_no_bar() {
        let mut imported = with_stages(&[]);
        for row in &mut imported.timings {
            row.encode.clear();
            row.stages.clear();
        }
        let row = stage_time_row(String::new(), false, times(&imported, "re10k-2v-256", "atsplat"));
        assert_eq!((row.stages, row.total, row.untimed.as_deref()), (vec![], None, Some(GAUSSIANS_UNTIMED)));
    }

    /// Medians of stages may add up to more than the median of the whole.
    #[test]
    fn the_total_is_that_of_the_first_image() {
        let said = texts(&with_stages(&[("coarse", 0.2), ("head", 0.1)]));
        assert!(said.lines().any(|text| text == "265 ms") && !said.contains("305 ms"), "{said}");
    }

    #[test]
    fn a_stated_time_is_no_bar() {
        let seconds = Some(StatedSeconds { encode: 0.5, render: None, machine: "a card".to_owned() });
        let mut imported = nearest_view();
        imported.stated.insert("re10k-2v-256".to_owned(), StatedCost { gaussians: None, seconds });
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), imported]);
        results.timings.retain(|row| row.key.method == "atsplat");
        let said = texts(&results);
        assert!(said.contains("stated as 0.5 s on a card, not measured here"), "{said}");
        assert!(!said.contains("timed on a card"), "{said}");
        results.timings.clear();
        let plots = store_plots(&Source { label: "run", results: &results }).unwrap();
        assert!(plots.iter().all(|(name, _)| name != "run-re10k-2v-256-time"), "nothing was measured");
    }

    #[test]
    fn a_device_is_that_of_its_method() {
        let methods = ["a", "b"].map(|name| atsplat(name, |_| ())).to_vec();
        let mut results = results(vec![preset("re10k-2v-256")], methods);
        let of_second = results.timings.iter_mut().filter(|row| row.key.method == "b");
        of_second.for_each(|row| row.renderer_adapter = Some("card".to_owned()));
        let said = texts(&results);
        assert!(said.contains("; timed on a processor") && said.contains("; ATSplat (b): renderer on card"), "{said}");
        assert!(said.contains("; ATSplat (a): times of 3 of 4 trials; ATSplat (b): times of 2 of 4 trials"), "{said}");
    }
}
