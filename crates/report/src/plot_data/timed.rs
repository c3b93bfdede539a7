use std::collections::BTreeSet;

use atsplat_numeric::distinct;
use atsplat_results::times::Machine;

use crate::table::{BUSY, TimeScope};

/// On what the methods of a plot were timed, and what the marks of their times mean, in words for its heading.
#[derive(Debug, Default)]
pub(super) struct Timed {
    methods: Vec<TimedMethod>,
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

    /// The marks of a time that is shown.
    pub(super) fn mark(&mut self, scope: Option<TimeScope>, busy: bool) {
        self.scopes.extend(scope.map(TimeScope::explained));
        self.busy |= busy;
    }

    /// `; timed on a processor; ATSplat: network on a card; § the machine was busy`. What holds for all methods names none.
    pub(super) fn in_words(&self) -> String {
        let machines = distinct(self.methods.iter().map(|method| method.machine.as_str()));
        let devices = distinct(self.methods.iter().filter_map(|method| method.device.as_deref()));
        let on_machine =
            |machine: &str| self.of_some(&format!("timed on {machine}"), |method| method.machine == machine);
        let on_device = |device: &str| self.of_some(device, |method| method.device.as_deref() == Some(device));
        let mut parts: Vec<String> = machines.into_iter().map(on_machine).collect();
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
