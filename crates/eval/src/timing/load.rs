use std::fs;
use std::time::Instant;

use rayon::ThreadPool;
use serde::{Deserialize, Serialize};

/// The machine's load while times were measured; `None` if the system does not report it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Load {
    /// Load average of the minute before.
    pub average_before: Option<f64>,
    /// Load average of the last minute at the end, including the pass's own threads.
    pub average_after: Option<f64>,
    /// Mean clock of the processors before, in MHz.
    pub mhz_before: Option<f64>,
    /// Mean clock of the processors at the end, in MHz.
    pub mhz_after: Option<f64>,
    /// Share of the machine's processors, from 0 to 1, used by anything but the pass: other processes, other threads of this
    /// process, and other guests of the same host.
    pub others: Option<f64>,
}

impl Load {
    /// From this share of others on, times are marked as unreliable. Below it, a pool with as many threads as the
    /// machine has processors is slowed by no more than the repetitions' own spread.
    pub const BUSY: f64 = 0.05;

    /// Whether others used so much that times cannot be trusted; `false` if the system does not report it.
    pub fn is_busy(&self) -> bool {
        self.others.is_some_and(|others| others >= Self::BUSY)
    }

    pub(super) const fn numbers(&self) -> [Option<f64>; 5] {
        let Self { average_before, average_after, mhz_before, mhz_after, others } = *self;
        [average_before, average_after, mhz_before, mhz_after, others]
    }
}

/// Which processor time counts as the pass's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OwnTime {
    /// That of the pool's threads.
    Pool,
    /// That of the whole process: GPU drivers have their own threads.
    Process,
}

/// Measures the load between [`LoadMonitor::start`] and [`LoadMonitor::finish`].
#[derive(Debug)]
pub(super) struct LoadMonitor<'a> {
    pool: &'a ThreadPool,
    own: OwnTime,
    start: Instant,
    average: Option<f64>,
    mhz: Option<f64>,
    cpu: Option<CpuTime>,
    own_secs: Option<f64>,
}

impl<'a> LoadMonitor<'a> {
    pub(super) fn start(pool: &'a ThreadPool, own: OwnTime) -> Self {
        let (average, mhz) = (load_average(), mean_mhz());
        Self { pool, own, start: Instant::now(), average, mhz, cpu: cpu_time(), own_secs: own_secs(pool, own) }
    }

    /// `outside` is the processor time in seconds that the methods' own processes have used during the pass.
    pub(super) fn finish(self, outside: f64) -> Load {
        let wall = self.start.elapsed().as_secs_f64();
        let (busy, own) = (cpu_time(), own_secs(self.pool, self.own));
        let others = || {
            let (before, after) = (self.cpu?, busy?);
            share_of_others(after.busy_secs - before.busy_secs, own? - self.own_secs? + outside, wall * after.cpus)
        };
        Load {
            average_before: self.average,
            average_after: load_average(),
            mhz_before: self.mhz,
            mhz_after: mean_mhz(),
            others: others(),
        }
    }
}

/// Share of `capacity` processor seconds that were busy but not with the pass itself.
fn share_of_others(busy: f64, own: f64, capacity: f64) -> Option<f64> {
    let share = (busy - own) / capacity;
    share.is_finite().then(|| share.clamp(0.0, 1.0))
}

/// Processor time of the whole machine.
#[derive(Clone, Copy, Debug, PartialEq)]
struct CpuTime {
    busy_secs: f64,
    cpus: f64,
}

/// Linux's `USER_HZ`, ticks per second, on every architecture that Rust supports.
const TICKS_PER_SEC: f64 = 100.0;

fn cpu_time() -> Option<CpuTime> {
    of_stat(&fs::read_to_string("/proc/stat").ok()?)
}

/// `/proc/stat`: user, nice, system, idle, iowait, irq, softirq, steal; guests are in user already (`proc_stat(5)`).
fn of_stat(stat: &str) -> Option<CpuTime> {
    let ticks: Vec<f64> = stat
        .lines()
        .find_map(|line| line.strip_prefix("cpu "))?
        .split_whitespace()
        .take(8)
        .map(|ticks| ticks.parse().ok())
        .collect::<Option<_>>()?;
    let [user, nice, system, _idle, _iowait, irq, softirq, steal] = ticks.try_into().ok()?;
    let is_cpu =
        |line: &&str| line.strip_prefix("cpu").is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()));
    let cpus = stat.lines().filter(is_cpu).count();
    Some(CpuTime { busy_secs: (user + nice + system + irq + softirq + steal) / TICKS_PER_SEC, cpus: cpus as f64 })
}

fn own_secs(pool: &ThreadPool, own: OwnTime) -> Option<f64> {
    match own {
        OwnTime::Pool => pool.broadcast(|_| thread_secs()).into_iter().sum(),
        OwnTime::Process => processor_secs_of_stat(&fs::read_to_string("/proc/self/stat").ok()?),
    }
}

/// Seconds for which the calling thread has been running.
fn thread_secs() -> Option<f64> {
    let text = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanos: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(1e-9 * nanos)
}

/// `/proc/PID/stat` in seconds: the name ends with the last parenthesis; user and system time are the 14th and 15th fields (`proc_pid_stat(5)`).
pub(crate) fn processor_secs_of_stat(stat: &str) -> Option<f64> {
    let (_, fields) = stat.rsplit_once(')')?;
    let mut fields = fields.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS_PER_SEC)
}

fn load_average() -> Option<f64> {
    fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}

fn mean_mhz() -> Option<f64> {
    of_cpuinfo(&fs::read_to_string("/proc/cpuinfo").ok()?)
}

fn of_cpuinfo(text: &str) -> Option<f64> {
    let clocks =
        text.lines().filter_map(|line| line.strip_prefix("cpu MHz")?.split_once(':')?.1.trim().parse::<f64>().ok());
    let (sum, count) = clocks.fold((0.0, 0u32), |(sum, count), mhz| (sum + mhz, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    const STAT: &str = "cpu  400 100 50 9000 70 20 30 10 400 0\n\
                        cpu0 200 50 25 4500 35 10 15 5 200 0\ncpu1 200 50 25 4500 35 10 15 5 200 0\nintr 12 0\nctxt 9\n";

    #[test]
    fn busy_time_excludes_idle_and_iowait() {
        let machine = of_stat(STAT).unwrap();
        Tolerance::F64.assert([machine.busy_secs, machine.cpus], [6.1, 2.0], "user, nice, system, irq, softirq, steal");
        assert_eq!(of_stat("cpu 1 2 3\n"), None);
        assert_eq!(of_stat(""), None);
    }

    #[test]
    fn reads_process_times_and_clocks() {
        let stat = "42 (a (b) c) R 1 1 1 0 -1 0 7 8 9 10 150 50 3 4 20 0 1 0 5 6 7";
        Tolerance::F64.assert(processor_secs_of_stat(stat), [2.0], "user and system time");
        assert_eq!(processor_secs_of_stat("42 no name"), None);
        Tolerance::F64.assert(of_cpuinfo("cpu MHz\t\t: 2600.0\nflags\t: x\ncpu MHz\t\t: 2000.0\n"), [2300.0], "MHz");
        assert_eq!(of_cpuinfo("BogoMIPS : 50"), None);
    }

    /// Two processors for two seconds: 3.2 of 4 seconds were busy, 3 of them with the pass.
    #[test]
    fn others_are_busy_time_minus_the_pass() {
        Tolerance::F64.assert(share_of_others(3.2, 3.0, 4.0), [0.05], "a twentieth");
        Tolerance::EXACT.assert(share_of_others(3.0, 3.1, 4.0), [0.0], "ticks are coarser than the pass's clock");
        assert_eq!(share_of_others(0.0, 0.0, 0.0), None);
        let load = |others| Load { others, ..Load::default() };
        assert_eq!([None, Some(0.049), Some(0.051)].map(|others| load(others).is_busy()), [false, false, true]);
    }

    /// As many busy threads as there are processors, and an idle pool.
    #[test]
    fn threads_outside_the_pool_count_as_others() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        if cpu_time().is_none() || thread_secs().is_none() {
            return;
        }
        let stop = std::sync::atomic::AtomicBool::new(false);
        let threads = std::thread::available_parallelism().unwrap().get();
        let load = std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    while !stop.load(std::sync::atomic::Ordering::Relaxed) {
                        std::hint::spin_loop();
                    }
                });
            }
            let monitor = LoadMonitor::start(&pool, OwnTime::Pool);
            std::thread::sleep(std::time::Duration::from_millis(400));
            let load = monitor.finish(0.0);
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
            load
        });
        // A container may have fewer processors than its machine.
        let share = threads as f64 / cpu_time().unwrap().cpus;
        assert!(load.others.unwrap() > 0.5 * share, "{load:?}");
    }
}
