//! For how long a processor quota paused this process.

use std::fs;
use std::path::Path;

/// Where the control groups of Linux's two versions are mounted, alone and next to each other. The first that exists counts:
/// `cpu` is often a link to `cpu,cpuacct`.
const UNIFIED: [&str; 2] = ["unified", ""];
const DIVIDED: [&str; 2] = ["cpu,cpuacct", "cpu"];

/// Seconds for which processors were withheld from this process's control group, or from one above it, because a quota was
/// used up, such as the limit of a container; those of several processors are added up. `None` if the system does not report it.
pub(super) fn throttled_secs() -> Option<f64> {
    throttled_below(Path::new("/sys/fs/cgroup"), &fs::read_to_string("/proc/self/cgroup").ok()?)
}

/// `groups` has a line `ID:CONTROLLERS:PATH` for each hierarchy (`cgroups(7)`). In a container, the path may be that of the
/// host, while only the container's group is mounted.
fn throttled_below(mounts: &Path, groups: &str) -> Option<f64> {
    let of_hierarchy = |line: &str| {
        let (_, line) = line.split_once(':')?;
        let (controllers, path) = line.split_once(':')?;
        let names = match controllers {
            "" => UNIFIED,
            _ if controllers.split(',').any(|name| name == "cpu") => DIVIDED,
            _ => return None,
        };
        let mount =
            names.map(|name| mounts.join(name)).into_iter().find(|mount| mount.join("cgroup.procs").exists())?;
        let path = Path::new(path.trim_start_matches('/'));
        let secs = |group: &Path| throttled(&fs::read_to_string(mount.join(group).join("cpu.stat")).ok()?);
        path.ancestors().filter_map(secs).reduce(|sum, secs| sum + secs)
    };
    groups.lines().filter_map(of_hierarchy).reduce(|sum, secs| sum + secs)
}

/// The field of `cpu.stat`: microseconds in version 2, nanoseconds in version 1. Version 2's root group has none.
fn throttled(stat: &str) -> Option<f64> {
    let field = |line: &str| {
        let (name, count) = line.split_once(' ')?;
        let unit = match name {
            "throttled_usec" => 1e-6,
            "throttled_time" => 1e-9,
            _ => return None,
        };
        Some(unit * count.trim().parse::<f64>().ok()?)
    };
    stat.lines().find_map(field)
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    /// Files of control groups with the `cpu.stat` of each.
    fn mounted(stats: &[(&str, &str)]) -> tempfile::TempDir {
        let mounts = tempfile::tempdir().unwrap();
        for (group, stat) in stats {
            let folder = mounts.path().join(group);
            fs::create_dir_all(&folder).unwrap();
            fs::write(folder.join("cgroup.procs"), "").unwrap();
            fs::write(folder.join("cpu.stat"), stat).unwrap();
        }
        mounts
    }

    #[test]
    fn reads_quotas_of_both_versions_and_of_groups_above() {
        let new = mounted(&[
            ("", "usage_usec 9\n"),
            ("pods", "nr_throttled 7\nthrottled_usec 500000\n"),
            ("pods/this", "usage_usec 9\nthrottled_usec 1250000\n"),
            ("pods/other", "throttled_usec 8000000\n"),
        ]);
        Tolerance::F64.assert(
            throttled_below(new.path(), "0::/pods/this\n"),
            [1.75],
            "version 2, the group and its parent",
        );
        let stat = "nr_periods 20\nnr_throttled 5\nthrottled_time 2500000000\n";
        let old = mounted(&[("cpu,cpuacct/this", stat), ("cpu,cpuacct", "throttled_time 0\n"), ("cpu/this", stat)]);
        let groups = "5:memory:/this\n4:cpu,cpuacct:/this\n1:name=systemd:/this\n0::/this\n";
        Tolerance::F64.assert(throttled_below(old.path(), groups), [2.5], "version 1");
    }

    #[test]
    fn a_container_sees_its_group_as_the_root() {
        let mounts = mounted(&[("", "throttled_usec 3000000\n")]);
        Tolerance::F64.assert(throttled_below(mounts.path(), "0::/docker/of-the-host\n"), [3.0], "what is mounted");
    }

    #[test]
    fn systems_without_quotas_report_nothing() {
        let mounts = mounted(&[("", "usage_usec 9\n"), ("broken", "throttled_usec many\n")]);
        for groups in ["", "0::/", "0::/broken", "0::/absent", "no group", "3:cpu:/"] {
            assert_eq!(throttled_below(mounts.path(), groups), None, "{groups}");
        }
    }
}
