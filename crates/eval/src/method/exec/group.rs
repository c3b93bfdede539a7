//! The group of a method's process and all its children.

use std::fs;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;

use crate::timing::{processor_secs_of_stat, status_bytes};

/// The command in a new group. On Linux with util-linux's `setpriv` the kernel kills the process when the calling
/// thread ends, however it ends; elsewhere the process sees its standard input end. For those that it starts, see [`Guard`].
pub(super) fn ending_with_this_thread(command: Command) -> Command {
    let mut command = if has_setpriv() { with_setpriv(&command) } else { command };
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    command
}

const SETPRIV: [&str; 4] = ["setpriv", "--pdeathsig", "KILL", "--"];

fn with_setpriv(command: &Command) -> Command {
    let [setpriv, options @ ..] = SETPRIV;
    let mut wrapped = Command::new(setpriv);
    wrapped.args(options).arg(command.get_program()).args(command.get_args());
    wrapped
}

/// A line of standard error as the program itself would say it: `setpriv` says that it cannot execute a program.
pub(super) fn without_starter(line: &str) -> &str {
    let [setpriv, ..] = SETPRIV;
    line.strip_prefix(setpriv).and_then(|rest| rest.strip_prefix(": ")).unwrap_or(line)
}

/// Whether `setpriv` knows the option; busybox's does not.
fn has_setpriv() -> bool {
    static FOUND: OnceLock<bool> = OnceLock::new();
    let quiet = |mut command: Command| {
        let command = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    };
    *FOUND.get_or_init(|| cfg!(target_os = "linux") && quiet(with_setpriv(&Command::new("true"))))
}

/// Kills all processes of a group; does nothing where there are no groups.
pub(super) fn kill(group: u32) {
    if cfg!(unix) {
        // The shell's `kill`: the standard library can only kill the first process.
        let mut shell = Command::new("sh");
        shell.args(["-c", "kill -s KILL -- \"-$0\"", &group.to_string()]);
        shell.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status().ok();
    }
}

/// Kills all processes of a group when this process ends, however it ends: a shell waits for the end of a pipe that no other
/// process has open. A process that left its group is not found. When this is dropped, nothing is killed.
#[derive(Debug)]
pub(super) struct Guard(Child);

impl Guard {
    /// `None` where there are no groups or no shell.
    pub(super) fn of(group: u32) -> Option<Self> {
        let mut shell = Command::new("sh");
        shell.args(["-c", "read -r line || kill -s KILL -- \"-$0\"", &group.to_string()]);
        // In another group, which the terminal's signals do not reach.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut shell, 0);
        let shell = shell.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        if cfg!(unix) { shell.spawn().ok().map(Self) } else { None }
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        if let Some(mut line) = self.0.stdin.take() {
            line.write_all(b"\n").ok();
        }
        self.0.wait().ok();
    }
}

/// Sum of the peaks of resident memory of a group's processes in bytes, each since its start; `None` if the system does not
/// report it.
pub(super) fn peak_bytes(group: u32) -> Option<u64> {
    let peaks = members(group).into_iter();
    let peaks =
        peaks.filter_map(|(process, _)| status_bytes(&fs::read_to_string(process.join("status")).ok()?, "VmHWM:"));
    peaks.reduce(u64::saturating_add)
}

/// Seconds for which a group's processes have been running on processors; `None` if the system does not report it.
pub(super) fn processor_secs(group: u32) -> Option<f64> {
    members(group).iter().filter_map(|(_, stat)| processor_secs_of_stat(stat)).reduce(|sum, secs| sum + secs)
}

/// The folders of a group's processes in `/proc`, each with its `stat`.
fn members(group: u32) -> Vec<(PathBuf, String)> {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten().map(|entry| entry.path());
    let member = |process: PathBuf| {
        let stat = fs::read_to_string(process.join("stat")).ok()?;
        (group_of(&stat)? == group).then_some((process, stat))
    };
    processes.filter_map(member).collect()
}

/// The group in `/proc/PID/stat`, the fifth field; the name in parentheses may contain anything (`proc_pid_stat(5)`).
fn group_of(stat: &str) -> Option<u32> {
    let (_, fields) = stat.rsplit_once(')')?;
    fields.split_whitespace().nth(2)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_do_not_name_the_program_that_starts_another() {
        let line = "setpriv: failed to execute /no/method: No such file or directory";
        assert_eq!(without_starter(line), "failed to execute /no/method: No such file or directory");
        assert_eq!(without_starter("error: setpriv: no"), "error: setpriv: no");
    }

    #[test]
    fn reads_the_group_behind_any_name() {
        assert_eq!(group_of("42 (a) 7 (b) S 1 9 8 0 -1"), Some(9));
        assert_eq!(group_of("42 sh S 1 9"), None);
    }

    /// A process that waits for one that it started.
    #[cfg(target_os = "linux")]
    fn with_child() -> Child {
        let mut shell = Command::new("sh");
        shell.args(["-c", "sleep 77; true"]).stdin(Stdio::null());
        std::os::unix::process::CommandExt::process_group(&mut shell, 0);
        let shell = shell.spawn().unwrap();
        assert!(eventually(|| living(shell.id()) == 2), "it starts another one");
        shell
    }

    #[cfg(target_os = "linux")]
    fn living(group: u32) -> usize {
        let is_zombie =
            |stat: &str| stat.rsplit_once(')').is_some_and(|(_, fields)| fields.trim_start().starts_with('Z'));
        members(group).iter().filter(|(_, stat)| !is_zombie(stat)).count()
    }

    #[cfg(target_os = "linux")]
    fn eventually(condition: impl Fn() -> bool) -> bool {
        let wait = || std::thread::sleep(std::time::Duration::from_millis(20));
        (0..500).any(|_| {
            wait();
            condition()
        })
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_guard_kills_the_whole_group_when_the_pipe_ends() {
        let mut shell = with_child();
        let mut guard = Guard::of(shell.id()).unwrap();
        drop(guard.0.stdin.take());
        assert!(eventually(|| living(shell.id()) == 0), "one of them lives on");
        shell.wait().unwrap();
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_guard_that_is_dropped_kills_nothing() {
        let mut shell = with_child();
        drop(Guard::of(shell.id()).unwrap());
        assert_eq!(living(shell.id()), 2);
        kill(shell.id());
        shell.wait().unwrap();
        assert!(eventually(|| living(shell.id()) == 0));
    }
}
