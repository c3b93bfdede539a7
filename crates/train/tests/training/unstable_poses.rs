//! Samples whose poses have no stable normalisation are used, and their scenes counted.

use std::collections::BTreeMap;
use std::path::Path;

use atsplat_scene::Warnings;
use atsplat_train::samples::{DatasetConfig, DatasetSource, Mixture, Sample, SampleId, Source, UnstablePoses};
use atsplat_train::{Event, Limits, Start, TrainError, Trainer};
use tempfile::tempdir;

use crate::common::{config, sample};
use crate::sources::{RULE, rooms_of};

/// Scenes of a moving camera and of one that stands still.
const SCENES: [&str; 2] = ["rooms-train-00000000", "rooms-train-00000001"];
const COINCIDENT: &str = "all camera centres coincide within the precision of their poses; lengths keep their scale";

fn id(number: u64) -> SampleId {
    SampleId { seed: 4, number, step: 0 }
}

/// Twelve frames of each scene, all those of the second with the pose of its last one.
fn write_scenes(folder: &Path) -> DatasetConfig {
    let config = rooms_of(folder, [12; 2]);
    let trajectory = config.path.join(SCENES[1]).with_extension("txt");
    let text = std::fs::read_to_string(&trajectory).unwrap();
    let pose: Vec<&str> = text.lines().next_back().unwrap().split(' ').skip(7).collect();
    assert_eq!(pose.len(), 12);
    let still = |line: &str| {
        let fields: Vec<&str> = line.split(' ').collect();
        if fields.len() == 19 { [&fields[..7], &pose[..]].concat().join(" ") } else { line.to_owned() }
    };
    std::fs::write(&trajectory, text.lines().map(still).collect::<Vec<_>>().join("\n")).unwrap();
    config
}

#[test]
fn scenes_of_a_camera_that_stands_still_are_counted() {
    let folder = tempdir().unwrap();
    let source = DatasetSource::open(write_scenes(folder.path()), RULE, &mut Warnings::new()).unwrap();
    assert_eq!(source.unstable_poses(), UnstablePoses::default());
    let names: Vec<String> = (0..20).map(|number| source.sample(id(number)).unwrap().name).collect();
    let first = |scene: &str| names.iter().find(|name| name.starts_with(scene)).unwrap();
    assert!(first(SCENES[0]).contains("frames"), "both scenes are drawn");
    let example = format!("{}: {COINCIDENT}", first(SCENES[1]));
    let unstable = source.unstable_poses();
    assert_eq!(unstable.scenes, BTreeMap::from([(SCENES[1].to_owned(), example.clone())]));
    let expected = format!("poses of samples of 1 scene have no stable normalisation, such as {example}");
    assert_eq!(unstable.to_string(), expected);
    let mixture = Mixture::new(vec![(1.0, Box::new(source))], false, None).unwrap();
    assert_eq!(mixture.unstable_poses(), unstable, "of a run's data");
}

/// Noise of a scene without a stable normalisation.
#[derive(Debug)]
struct Still;

impl Source for Still {
    fn name(&self) -> String {
        "noise".to_owned()
    }

    fn sample(&self, id: SampleId) -> Result<Sample, TrainError> {
        Ok(sample(id.number))
    }

    fn unstable_poses(&self) -> UnstablePoses {
        UnstablePoses { scenes: BTreeMap::from([("still".to_owned(), format!("noise 0: {COINCIDENT}"))]) }
    }
}

/// Reports follow the opening and each checkpoint.
#[test]
fn a_run_reports_such_scenes_once() {
    let folder = tempdir().unwrap();
    let mut trainer = Trainer::with_samples(config(""), Box::new(Still), folder.path(), &Start::Fresh).unwrap();
    let mut notices = Vec::new();
    let mut on_event = |event: &Event<'_>| {
        if let Event::Notice(text) = event {
            notices.push((*text).to_owned());
        }
    };
    trainer.run(Limits { steps: Some(5), time: None }, &mut on_event).unwrap();
    let expected = format!("poses of samples of 1 scene have no stable normalisation, such as noise 0: {COINCIDENT}");
    assert_eq!(notices.iter().filter(|notice| notice.contains("normalisation")).collect::<Vec<_>>(), [&expected]);
}
