use std::fs;
use std::thread;
use std::time::{Duration, Instant};

use atsplat_numeric::Extremes as _;
use atsplat_results::times::Load;
use rayon::ThreadPool;

use super::quota::throttled_secs;

/// Which processor time counts as that of the pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CountedTime {
    /// That of the pool's threads.
    Pool,
    /// That of the whole process: GPU drivers have their own threads.
    Process,
}

/// Measures the load between [`LoadMonitor::start`] and [`LoadMonitor::finish`].
#[derive(Debug)]
pub(super) struct LoadMonitor<'a> {
    pool: &'a ThreadPool,
    counted: CountedTime,
    start: Instant,
    average: Option<f64>,
    mhz: Option<f64>,
    cpu: Option<CpuTime>,
    counted_secs: Option<f64>,
    throttled_secs: Option<f64>,
}

impl<'a> LoadMonitor<'a> {
    /// The machine's clock has ticks of 10 ms: in less time than this, they tell little.
    pub(super) const SHORTEST: Duration = Duration::from_millis(250);

    pub(super) fn start(pool: &'a ThreadPool, counted: CountedTime) -> Self {
        let (average, mhz, throttled_secs) = (load_average(), mean_mhz(), throttled_secs());
        let start = Instant::now();
        let (cpu, counted_secs) = (cpu_time(), counted_secs(pool, counted));
        Self { pool, counted, start, average, mhz, cpu, counted_secs, throttled_secs }
    }

    /// `outside` gives the processor time in seconds that the method's processes have used meanwhile. Waits until
    /// [`Self::SHORTEST`] has passed.
    pub(super) fn finish(self, outside: impl FnOnce() -> f64) -> Load {
        thread::sleep(Self::SHORTEST.saturating_sub(self.start.elapsed()));
        let wall = self.start.elapsed().as_secs_f64();
        let (busy, counted, throttled) = (cpu_time(), counted_secs(self.pool, self.counted), throttled_secs());
        // Last: looking for these processes takes processor time too.
        let outside = outside();
        let others = || {
            let (before, after) = (self.cpu?, busy?);
            let use_of = Use {
                busy: after.busy_secs - before.busy_secs,
                pass: counted? - self.counted_secs? + outside,
                threads: self.pool.current_num_threads() as f64,
                cpus: after.cpus,
            };
            use_of.share_of_others(wall)
        };
        let withheld = || finite((throttled? - self.throttled_secs?) / wall);
        let (others, withheld) = (others(), withheld());
        tracing::debug!(wall, others, withheld, "load");
        Load {
            average_before: self.average,
            average_after: load_average(),
            mhz_before: self.mhz,
            mhz_after: mean_mhz(),
            others: others.into_iter().chain(withheld).reduce(f64::maximum_of),
        }
    }
}

/// What processors did meanwhile, in seconds.
#[derive(Clone, Copy, Debug)]
struct Use {
    /// All that the machine did.
    busy: f64,
    /// What the pass itself did.
    pass: f64,
    threads: f64,
    cpus: f64,
}

impl Use {
    /// Share of the pass's processors that others could have kept busy. Two ticks, and one for each of these processors, may be
    /// nothing but the coarseness of the machine's clock.
    fn share_of_others(self, wall: f64) -> Option<f64> {
        let Self { busy, pass, threads, cpus } = self;
        // A method's processes may have more threads than the pool.
        let processors = threads.maximum_of(pass / wall).minimum_of(cpus);
        let others = busy - pass;
        let noise = (2.0 + processors) / TICKS_PER_SEC;
        finite(if others <= noise { 0.0 } else { others / (wall * processors) })
    }
}

/// A share, if it is a number.
fn finite(share: f64) -> Option<f64> {
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
    cpu_time_of_stat(&fs::read_to_string("/proc/stat").ok()?)
}

/// `/proc/stat`: user, nice, system, idle, iowait, irq, softirq, steal; guests are in user already (`proc_stat(5)`).
fn cpu_time_of_stat(stat: &str) -> Option<CpuTime> {
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

fn counted_secs(pool: &ThreadPool, counted: CountedTime) -> Option<f64> {
    match counted {
        CountedTime::Pool => pool.broadcast(|_| thread_secs()).into_iter().sum(),
        CountedTime::Process => processor_secs_of_stat(&fs::read_to_string("/proc/self/stat").ok()?),
    }
}

/// Seconds for which the calling thread has been running.
fn thread_secs() -> Option<f64> {
    let text = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanos: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(1e-9 * nanos)
}

/// `/proc/PID/stat` in seconds: the name ends with the last parenthesis; user and system time are the 14th and 15th fields, those
/// of the process's children that have ended the two after them (`proc_pid_stat(5)`).
pub(crate) fn processor_secs_of_stat(stat: &str) -> Option<f64> {
    let (_, fields) = stat.rsplit_once(')')?;
    let ticks: Vec<f64> = fields.split_whitespace().skip(11).take(4).map_while(|ticks| ticks.parse().ok()).collect();
    (ticks.len() == 4).then(|| ticks.iter().sum::<f64>() / TICKS_PER_SEC)
}

fn load_average() -> Option<f64> {
    fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}

fn mean_mhz() -> Option<f64> {
    mean_mhz_of_cpuinfo(&fs::read_to_string("/proc/cpuinfo").ok()?)
}

fn mean_mhz_of_cpuinfo(text: &str) -> Option<f64> {
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
        let machine = cpu_time_of_stat(STAT).unwrap();
        Tolerance::F64.assert([machine.busy_secs, machine.cpus], [6.1, 2.0], "user, nice, system, irq, softirq, steal");
        assert_eq!(cpu_time_of_stat("cpu 1 2 3\n"), None);
        assert_eq!(cpu_time_of_stat(""), None);
    }

    #[test]
    fn reads_process_times_and_clocks() {
        let stat = "42 (a (b) c) R 1 1 1 0 -1 0 7 8 9 10 150 50 3 4 20 0 1 0 5 6 7";
        Tolerance::F64.assert(processor_secs_of_stat(stat), [2.07], "user and system time, and those of children");
        assert_eq!(processor_secs_of_stat("42 no name"), None);
        Tolerance::F64.assert(
            mean_mhz_of_cpuinfo("cpu MHz\t\t: 2600.0\nflags\t: x\ncpu MHz\t\t: 2000.0\n"),
            [2300.0],
            "MHz",
        );
        assert_eq!(mean_mhz_of_cpuinfo("BogoMIPS : 50"), None);
    }

    /// Two processors for two seconds: 3.2 of 4 seconds were busy, 3 of them with the pass.
    #[test]
    fn others_are_busy_time_minus_the_pass() {
        let share = |busy, pass| Use { busy, pass, threads: 2.0, cpus: 2.0 }.share_of_others(2.0);
        Tolerance::F64.assert(share(3.2, 3.0), [0.05], "a twentieth");
        Tolerance::EXACT.assert(share(3.0, 3.1), [0.0], "ticks are coarser than the pass's clock");
        assert_eq!(Use { busy: 0.0, pass: 0.0, threads: 0.0, cpus: 0.0 }.share_of_others(0.0), None);
    }

    /// A neighbour on half of one of 32 processors for two seconds.
    #[test]
    fn a_neighbour_counts_against_the_processors_that_the_pass_uses() {
        let share = |pass, threads| Use { busy: pass + 1.0, pass, threads, cpus: 32.0 }.share_of_others(2.0);
        Tolerance::F64.assert(share(2.0, 1.0), [0.5], "one thread");
        Tolerance::F64.assert(share(20.0, 1.0), [0.05], "processes of the method on ten processors");
        Tolerance::F64.assert(share(20.0, 64.0), [1.0 / 64.0], "no more threads than processors");
    }

    #[test]
    fn a_few_ticks_in_a_short_time_do_not_count_as_load() {
        let share =
            |ticks: f64, wall| Use { busy: 0.01 * ticks, pass: 0.0, threads: 2.0, cpus: 2.0 }.share_of_others(wall);
        assert_eq!([share(1.0, 0.05), share(3.9, 0.2)], [Some(0.0), Some(0.0)]);
        Tolerance::F64.assert([share(5.0, 0.05), share(5.0, 0.2)].map(Option::unwrap), [0.5, 0.125], "more than noise");
    }

    /// As many busy threads as there are processors, and an idle pool.
    #[test]
    fn threads_outside_the_pool_count_as_others() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        if cpu_time().is_none() || thread_secs().is_none() {
            return;
        }
        let stop = std::sync::atomic::AtomicBool::new(false);
        let threads = thread::available_parallelism().unwrap().get();
        let load = thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    while !stop.load(std::sync::atomic::Ordering::Relaxed) {
                        std::hint::spin_loop();
                    }
                });
            }
            // Nothing was done in between, which is too short to measure.
            let load = LoadMonitor::start(&pool, CountedTime::Pool).finish(|| 0.0);
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
            load
        });
        assert!(load.others.unwrap() > 0.5, "{load:?}");
    }
}
