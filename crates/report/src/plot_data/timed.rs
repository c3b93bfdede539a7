use std::collections::BTreeSet;

use atsplat_numeric::distinct;
use atsplat_results::times::Machine;

use crate::table::{BUSY, TimeScope};

/// On what the methods of a plot were timed, and what the marks of their times mean, in words for its heading.
#[derive(Debug, Default)]
pub(super) struct Timed {
    methods: Vec<TimedMethod>,
    /// Methods of which a part of the trials was timed: their titles, and `times of 2 of 8 trials`.
    parts: Vec<(String, String)>,
    scopes: BTreeSet<String>,
    busy: bool,
}

#[derive(Debug, PartialEq)]
struct TimedMethod {
    title: String,
    machine: String,
    /// What ran on a graphics adapter, and on which.
    device: Option<String>,
}

impl Timed {
    pub(super) fn add(&mut self, title: &str, machine: &Machine, device: Option<&str>) {
        let (title, device) = (title.to_owned(), device.map(str::to_owned));
        let method = TimedMethod { title, machine: machine.to_string(), device };
        if !self.methods.contains(&method) {
            self.methods.push(method);
        }
    }

    /// How many of a method's trials were timed, and of how many.
    pub(super) fn trials(&mut self, title: &str, [timed, there]: [u64; 2]) {
        let part = (title.to_owned(), format!("times of {timed} of {there} trials"));
        if timed < there && !self.parts.contains(&part) {
            self.parts.push(part);
        }
    }

    /// The marks of a time that is shown.
    pub(super) fn mark(&mut self, scope: Option<TimeScope>, busy: bool) {
        self.scopes.extend(scope.map(TimeScope::explained));
        self.busy |= busy;
    }

    /// `; timed on a processor; times of 2 of 8 trials; ATSplat: network on a card; § the machine was busy`. What holds for all
    /// methods names none.
    pub(super) fn in_words(&self) -> String {
        let machines = distinct(self.methods.iter().map(|method| method.machine.as_str()));
        let devices = distinct(self.methods.iter().filter_map(|method| method.device.as_deref()));
        let on_machine =
            |machine: &str| self.of_some(&format!("timed on {machine}"), |method| method.machine == machine);
        let on_device = |device: &str| self.of_some(device, |method| method.device.as_deref() == Some(device));
        let mut parts: Vec<String> = machines.into_iter().map(on_machine).collect();
        let on_trials = |text: &str| {
            let is_of =
                |method: &TimedMethod| self.parts.iter().any(|(title, of)| *title == method.title && of == text);
            self.of_some(text, is_of)
        };
        parts.extend(distinct(self.parts.iter().map(|(_, text)| text.as_str())).into_iter().map(on_trials));
        parts.extend(devices.into_iter().map(on_device));
        parts.extend(self.scopes.iter().cloned());
        parts.extend(self.busy.then(|| format!("{BUSY} the machine was busy")));
        parts.into_iter().map(|part| format!("; {part}")).collect()
    }

    /// What holds for some methods, after their titles.
    fn of_some(&self, what: &str, holds: impl Fn(&TimedMethod) -> bool) -> String {
        let methods = self.methods.iter().filter(|method| holds(method));
        let titles: Vec<&str> = methods.map(|method| method.title.as_str()).collect();
        if titles.len() == self.methods.len() {
            return what.to_owned();
        }
        format!("{}: {what}", distinct(titles).join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_holds_for_some_methods_names_them() {
        let said = |methods: &[(&str, &str, Option<&str>)]| {
            let mut timed = Timed::default();
            for (title, processor, device) in methods.iter().copied() {
                let machine = Machine { processor: processor.to_owned(), threads: 1, cpus: 2, ..Machine::default() };
                timed.add(title, &machine, device);
            }
            timed.in_words()
        };
        assert_eq!(said(&[]), "");
        let on = |processor: &str| format!("timed on {processor}, 1 thread on 2 logical processors");
        assert_eq!(said(&[("A", "one", None), ("B", "one", None), ("A", "one", None)]), format!("; {}", on("one")));
        let card = "network on a card";
        assert_eq!(said(&[("A", "one", Some(card))]), format!("; {}; {card}", on("one")));
        assert_eq!(
            said(&[("A", "one", None), ("B", "two", Some(card)), ("C", "one", Some(card))]),
            format!("; A, C: {}; B: {}; B, C: {card}", on("one"), on("two"))
        );
    }

    #[test]
    fn times_of_a_part_of_the_trials_say_so() {
        let said = |methods: &[(&str, [u64; 2])]| {
            let mut timed = Timed::default();
            for (title, trials) in methods.iter().copied() {
                timed.add(
                    title,
                    &Machine { processor: "one".to_owned(), threads: 1, cpus: 2, ..Machine::default() },
                    None,
                );
                timed.trials(title, trials);
            }
            timed.in_words().replacen("; timed on one, 1 thread on 2 logical processors", "", 1)
        };
        assert_eq!(said(&[("A", [8, 8]), ("B", [3, 3])]), "");
        assert_eq!(said(&[("A", [2, 8]), ("B", [2, 8])]), "; times of 2 of 8 trials");
        assert_eq!(said(&[("A", [8, 8]), ("B", [2, 8]), ("C", [2, 8])]), "; B, C: times of 2 of 8 trials");
    }

    #[test]
    fn marks_are_explained_once() {
        let mut timed = Timed::default();
        for busy in [true, false] {
            timed.mark(Some(TimeScope::WholeAnswer), busy);
        }
        timed.mark(None, false);
        let expected = "; ‡ the whole answer, with reading and writing of files; § the machine was busy";
        assert_eq!(timed.in_words(), expected);
    }
}
