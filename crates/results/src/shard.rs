//! Which part of the scenes a process evaluates: given as `K/N`, or read from the environment variables of schedulers and
//! launchers of parallel programs.

use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// One of several parts of a run that is divided by scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Shard {
    /// Number of the part, from 1.
    pub number: u32,
    /// Number of parts.
    #[serde(alias = "of")]
    pub count: u32,
}

/// Text or environment variables that do not specify one part: what was expected, and what was found.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct InvalidShard(String);

/// Number of parts, for schedulers that number their jobs but do not tell them how many there are, and for arrays of one task.
const COUNT: &str = "ATSPLAT_SHARDS";

/// Rank and world size, as launchers of parallel programs set them.
const RANKS: [(&str, &str); 3] =
    [("RANK", "WORLD_SIZE"), ("OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"), ("PMI_RANK", "PMI_SIZE")];

impl FromStr for Shard {
    type Err = InvalidShard;

    /// `K/N`, or `env` for [`Shard::from_environment`].
    fn from_str(text: &str) -> Result<Self, InvalidShard> {
        if text == "env" {
            return Self::from_environment();
        }
        let parts = text.split_once('/').and_then(|(number, count)| Some((number.parse().ok()?, count.parse().ok()?)));
        let shard = parts
            .map(|(number, count)| Self { number, count })
            .filter(|shard| (1..=shard.count).contains(&shard.number));
        shard.ok_or_else(|| InvalidShard(format!("expected K/N with K from 1 to N, or env, found {text:?}")))
    }
}

impl Shard {
    /// The part that this process's environment variables specify: of a Slurm array, of an indexed Kubernetes job with
    /// `ATSPLAT_SHARDS`, or by the rank of torchrun or MPI.
    ///
    /// # Errors
    /// [`InvalidShard`] with the variables, if none specifies a part, some contradict each other, one is not a number, or an array
    /// has one task and `ATSPLAT_SHARDS` does not say that there is no other.
    pub fn from_environment() -> Result<Self, InvalidShard> {
        from_environment(&|name| std::env::var(name).ok()).map_err(InvalidShard)
    }
}

/// A part, and the variables that specify it.
#[derive(Clone, Debug)]
struct EnvironmentShard {
    shard: Shard,
    by: String,
}

/// A launcher of a single process is ignored if another one divides the work.
fn from_environment(variable: &dyn Fn(&str) -> Option<String>) -> Result<Shard, String> {
    let environment = Environment(variable);
    let slurm = environment.slurm()?;
    let is_lone_task = slurm.as_ref().is_some_and(|task| task.shard.count == 1) && environment.number(COUNT)?.is_none();
    let mut stated: Vec<EnvironmentShard> = Vec::from_iter(slurm);
    stated.extend(environment.kubernetes()?);
    for (rank, size) in RANKS {
        stated.extend(environment.rank(rank, size)?);
    }
    let divided: Vec<EnvironmentShard> = stated.iter().filter(|stated| stated.shard.count > 1).cloned().collect();
    if let Some(task) = stated.first().filter(|_| is_lone_task && divided.is_empty()) {
        return Err(format!(
            "expected an array of several tasks, or {COUNT} for the number of parts, found {}: a task of an array that is submitted \
             again alone does not know that there are others: give --shard K/N (or export {COUNT}=1 if there is one part)",
            task.by
        ));
    }
    let stated = if divided.is_empty() { stated } else { divided };
    let Some((first, others)) = stated.split_first() else {
        return Err(format!(
            "expected a Slurm array (SLURM_ARRAY_TASK_ID), an indexed Kubernetes job (JOB_COMPLETION_INDEX and {COUNT}), \
             torchrun (RANK, WORLD_SIZE) or MPI (OMPI_COMM_WORLD_RANK, PMI_RANK), found none of these variables"
        ));
    };
    match others.iter().find(|other| other.shard != first.shard) {
        None => Ok(first.shard),
        Some(other) => {
            let text =
                |EnvironmentShard { shard, by }: &EnvironmentShard| format!("{}/{} by {by}", shard.number, shard.count);
            Err(format!("expected one part, found {} and {}: give --shard K/N", text(first), text(other)))
        }
    }
}

struct Environment<'a>(&'a dyn Fn(&str) -> Option<String>);

impl Environment<'_> {
    fn number(&self, name: &str) -> Result<Option<u32>, String> {
        let Some(text) = (self.0)(name) else { return Ok(None) };
        let number = text.trim().parse();
        number.map(Some).map_err(|_error| format!("{name}: expected a whole number of at least 0, found {text:?}"))
    }

    fn required(&self, name: &str, because: &str) -> Result<u32, String> {
        self.number(name)?.ok_or_else(|| format!("{because} is set: expected {name} too, found none"))
    }

    /// `sbatch --array`: identifiers from a minimum, in steps. In an array with gaps the parts cannot be numbered.
    fn slurm(&self) -> Result<Option<EnvironmentShard>, String> {
        const ID: &str = "SLURM_ARRAY_TASK_ID";
        let Some(id) = self.number(ID)? else { return Ok(None) };
        let of_array = |name| self.required(name, ID);
        let (min, max) = (of_array("SLURM_ARRAY_TASK_MIN")?, of_array("SLURM_ARRAY_TASK_MAX")?);
        let (count, step) = (of_array("SLURM_ARRAY_TASK_COUNT")?, self.number("SLURM_ARRAY_TASK_STEP")?.unwrap_or(1));
        let text = format!("{ID}={id}, _MIN={min}, _MAX={max}, _COUNT={count}, _STEP={step}");
        let is_even =
            step > 0 && (min..=max).contains(&id) && (id - min) % step == 0 && (max - min) / step + 1 == count;
        if !is_even {
            return Err(format!("expected an array without gaps, such as --array=0-7, found {text}: give --shard K/N"));
        }
        let shard = Shard { number: (id - min) / step + 1, count };
        self.check_count(EnvironmentShard { shard, by: text }).map(Some)
    }

    /// `completionMode: Indexed`; pods do not know how many there are.
    fn kubernetes(&self) -> Result<Option<EnvironmentShard>, String> {
        const INDEX: &str = "JOB_COMPLETION_INDEX";
        let Some(index) = self.number(INDEX)? else { return Ok(None) };
        let count = self.required(COUNT, INDEX)?;
        shard_at(index, count, format!("{INDEX}={index}, {COUNT}={count}")).map(Some)
    }

    fn rank(&self, rank: &str, size: &str) -> Result<Option<EnvironmentShard>, String> {
        let (number, count) = match (self.number(rank)?, self.number(size)?) {
            (None, None) => return Ok(None),
            (Some(number), Some(count)) => (number, count),
            (Some(_), None) => return Err(format!("{rank} is set: expected {size} too, found none")),
            (None, Some(_)) => return Err(format!("{size} is set: expected {rank} too, found none")),
        };
        self.check_count(shard_at(number, count, format!("{rank}={number}, {size}={count}"))?).map(Some)
    }

    /// Rejects a part if `$ATSPLAT_SHARDS` is set to another number of parts.
    fn check_count(&self, stated: EnvironmentShard) -> Result<EnvironmentShard, String> {
        match self.number(COUNT)?.filter(|count| *count != stated.shard.count) {
            None => Ok(stated),
            Some(count) => Err(format!(
                "expected {COUNT}={count} parts, found {} by {}: give --shard K/{count}",
                stated.shard.count, stated.by
            )),
        }
    }
}

/// The part with this position, from 0.
fn shard_at(position: u32, count: u32, by: String) -> Result<EnvironmentShard, String> {
    if position < count {
        return Ok(EnvironmentShard { shard: Shard { number: position + 1, count }, by });
    }
    Err(format!("expected a position below the number of parts, found {by}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(variables: &[(&str, &str)]) -> Result<(u32, u32), String> {
        let find = |name: &str| variables.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned());
        from_environment(&find).map(|shard| (shard.number, shard.count))
    }

    fn slurm<'a>(id: &'a str, min: &'a str, max: &'a str, count: &'a str, step: &'a str) -> [(&'a str, &'a str); 5] {
        let names = ["ID", "MIN", "MAX", "COUNT", "STEP"];
        let names = names.map(|name| match name {
            "ID" => "SLURM_ARRAY_TASK_ID",
            "MIN" => "SLURM_ARRAY_TASK_MIN",
            "MAX" => "SLURM_ARRAY_TASK_MAX",
            "COUNT" => "SLURM_ARRAY_TASK_COUNT",
            _ => "SLURM_ARRAY_TASK_STEP",
        });
        let [a, b, c, d, e] = names;
        [(a, id), (b, min), (c, max), (d, count), (e, step)]
    }

    #[test]
    fn parses_shards() {
        assert_eq!("2/8".parse(), Ok(Shard { number: 2, count: 8 }));
        for broken in ["0/3", "4/3", "1", "1/0", "a/b", "-1/2", "1/2/3", "", "ENV"] {
            assert!(broken.parse::<Shard>().is_err(), "{broken:?}");
        }
    }

    #[test]
    fn each_scheduler_numbers_its_parts() {
        assert_eq!(of(&slurm("0", "0", "7", "8", "1")), Ok((1, 8)));
        assert_eq!(of(&slurm("3", "1", "8", "8", "1")), Ok((3, 8)));
        assert_eq!(of(&slurm("14", "10", "16", "4", "2")), Ok((3, 4)));
        assert_eq!(of(&[("JOB_COMPLETION_INDEX", "2"), ("ATSPLAT_SHARDS", "5")]), Ok((3, 5)));
        assert_eq!(of(&[("RANK", "0"), ("WORLD_SIZE", "4")]), Ok((1, 4)));
        assert_eq!(of(&[("OMPI_COMM_WORLD_RANK", "3"), ("OMPI_COMM_WORLD_SIZE", "4")]), Ok((4, 4)));
        assert_eq!(of(&[("PMI_RANK", "1"), ("PMI_SIZE", "2")]), Ok((2, 2)));
        assert_eq!(of(&[("RANK", "0"), ("WORLD_SIZE", "1")]), Ok((1, 1)));
    }

    /// `srun` of one task within an array sets PMI's variables to a world of one; `mpirun` sets its own and PMI's.
    #[test]
    fn launchers_that_agree_or_start_one_process_do_not_disturb() {
        let one = [("PMI_RANK", "0"), ("PMI_SIZE", "1")];
        assert_eq!(of(&[&slurm("5", "0", "7", "8", "1")[..], &one].concat()), Ok((6, 8)));
        let both = [("OMPI_COMM_WORLD_RANK", "1"), ("OMPI_COMM_WORLD_SIZE", "3"), ("PMI_RANK", "1"), ("PMI_SIZE", "3")];
        assert_eq!(of(&both), Ok((2, 3)));
        assert_eq!(of(&[&slurm("5", "0", "7", "8", "1")[..], &[("ATSPLAT_SHARDS", "8")]].concat()), Ok((6, 8)));
    }

    /// As `sbatch --array=5` starts the sixth of eight tasks again.
    #[test]
    fn a_task_of_an_array_alone_is_not_the_whole_run() {
        let lone = slurm("5", "5", "5", "1", "1");
        let with = |more: &[(&str, &str)]| of(&[&lone[..], more].concat());
        let starting_one = [("PMI_RANK", "0"), ("PMI_SIZE", "1")];
        for more in [&[][..], &starting_one] {
            let refused = with(more).unwrap_err();
            assert!(refused.contains("SLURM_ARRAY_TASK_ID=5") && refused.contains("give --shard K/N"), "{refused}");
        }
        assert_eq!(with(&[("ATSPLAT_SHARDS", "1")]), Ok((1, 1)));
        assert_eq!(with(&[("RANK", "2"), ("WORLD_SIZE", "4")]), Ok((3, 4)), "another launcher divides the work");
    }

    #[test]
    fn contradictions_name_their_variables() {
        let refused = |variables: &[(&str, &str)], names: &[&str]| {
            let error = of(variables).unwrap_err();
            for name in names {
                assert!(error.contains(name), "{name}: {error}");
            }
        };
        let ranks = [("RANK", "1"), ("WORLD_SIZE", "4")];
        refused(
            &[&slurm("1", "0", "7", "8", "1")[..], &ranks].concat(),
            &["SLURM_ARRAY_TASK_ID=1", "RANK=1", "2/8", "2/4"],
        );
        refused(&slurm("5", "1", "7", "3", "1"), &["without gaps", "_COUNT=3"]);
        refused(
            &slurm("3", "3", "3", "1", "1").iter().copied().chain([("ATSPLAT_SHARDS", "8")]).collect::<Vec<_>>(),
            &["ATSPLAT_SHARDS=8", "found 1", "--shard K/8"],
        );
        refused(
            &slurm("5", "0", "7", "8", "1")[..4]
                .iter()
                .copied()
                .filter(|(name, _)| !name.ends_with("COUNT"))
                .collect::<Vec<_>>(),
            &["SLURM_ARRAY_TASK_COUNT"],
        );
        refused(&[("JOB_COMPLETION_INDEX", "2")], &["JOB_COMPLETION_INDEX", "ATSPLAT_SHARDS"]);
        refused(&[("RANK", "1")], &["RANK", "WORLD_SIZE"]);
        refused(&[("WORLD_SIZE", "4")], &["WORLD_SIZE", "expected RANK"]);
        refused(&[("RANK", "4"), ("WORLD_SIZE", "4")], &["RANK=4"]);
        refused(&[("RANK", "one"), ("WORLD_SIZE", "4")], &["RANK", "one"]);
        refused(&[], &["SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX", "WORLD_SIZE"]);
    }
}
