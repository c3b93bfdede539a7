//! Files of imported methods by the names of scenes.

use std::path::Path;
use std::sync::Arc;

use crate::common::{Run, Walls, dataset, entry, image};
use atsplat_eval::GaussianFrame;
use atsplat_eval::method::{Method, NearestView, Ply, Renders, Splatting};
use atsplat_eval::runner::{Dataset, KeepImages};
use atsplat_pixels::encode_png;
use atsplat_results::{Results, TargetStatus};
use atsplat_splat::files::{Encoding, Output};
use atsplat_splat::{GaussianParts, Gaussians, files};

/// One name is another with the number of an entry.
const ROOMS: [&str; 2] = ["room", "room-0"];

fn run_of(keys: &[&str], method: Arc<dyn Method>) -> Run {
    let walls = Walls { keys: keys.iter().map(|key| (*key).to_owned()).collect(), ..Walls::new(0, 8) };
    Run::new(vec![dataset(walls, &[entry(&[0, 4], &[5])])], vec![method])
}

/// Names that need escaping, and a plain one.
#[test]
fn kept_images_of_any_scene_can_be_scored() {
    let folder = tempfile::tempdir().unwrap();
    let run = |method: Arc<dyn Method>| run_of(&["scène 1", "A/b", "wall"], method);
    let keeping = Run { images: KeepImages::All, ..run(Arc::new(NearestView)) };
    let (expected, _) = keeping.run(&folder.path().join("store")).unwrap();
    let kept = folder.path().join("store/images/walls/nearest-view");
    assert!(!kept.join("scène 1").exists() && !kept.join("scène 1-0").exists());
    let scoring = run(Arc::new(Renders::new(&kept, None).unwrap()));
    let found = scoring.plan().find_imported_files().unwrap();
    assert!(found[0].to_string().ends_with("SCENE-0/000029.png (3)"), "{}", found[0]);
    let (scored, _) = scoring.run(&folder.path().join("scored")).unwrap();
    let scores = |results: &Results| -> Vec<_> { results.targets.iter().map(|row| row.scores.clone()).collect() };
    assert_eq!(scores(&scored), scores(&expected));
    assert!(scores(&scored).iter().all(|scores| scores.contains_key("psnr")));
}

/// The renders of `room-0` are not there, or those of `room`.
#[test]
fn renders_of_a_scene_are_not_those_of_another_whose_name_is_its_entry() {
    let root = tempfile::tempdir().unwrap();
    let score = |keys: &[&str], folders: &[(&str, usize)]| {
        let renders = tempfile::tempdir_in(root.path()).unwrap();
        for (folder, scene) in folders {
            std::fs::create_dir_all(renders.path().join(folder)).unwrap();
            std::fs::write(renders.path().join(folder).join("000005.png"), encode_png(&image(*scene, 5)).unwrap())
                .unwrap();
        }
        let run = run_of(keys, Arc::new(Renders::new(renders.path(), Some("theirs")).unwrap()));
        let files = run.plan().find_imported_files().unwrap().remove(0).to_string();
        let (results, _) = run.run(&renders.path().join("store")).unwrap();
        let found = results.targets.iter().map(|row| match row.status {
            TargetStatus::Identical => "found".to_owned(),
            _ => row.detail.clone().unwrap_or_default().replace(&renders.path().display().to_string(), "renders"),
        });
        (files.rsplit(": ").next().unwrap_or_default().to_owned(), found.collect::<Vec<_>>())
    };
    let [missing, other] = ROOMS.map(|scene| {
        format!("no file for frame 5 of scene {scene}: expected {scene}/000005.png, .exr or .npy below renders")
    });
    let all = "SCENE/000029.png (2)".to_owned();
    let part = "SCENE/000029.png (1); 1 of 2 scenes are missing".to_owned();
    assert_eq!(score(&ROOMS, &[("room", 0), ("room-0", 1)]), (all, vec!["found".to_owned(); 2]));
    let without_first = vec![format!("{missing}; room-0 is the scene of that name"), "found".to_owned()];
    assert_eq!(score(&ROOMS, &[("room-0", 1)]), (part.clone(), without_first));
    assert_eq!(score(&ROOMS, &[("room", 0)]), (part, vec!["found".to_owned(), other]));
    let alone = ("SCENE-0/000029.png (1)".to_owned(), vec!["found".to_owned()]);
    assert_eq!(score(&ROOMS[..1], &[("room-0", 0)]), alone, "where no scene has that name");
}

/// Most programs write by scene: frame 5, which both entries have, would be that of the entry written last.
#[test]
fn renders_of_several_entries_are_named_by_entry() {
    let root = tempfile::tempdir().unwrap();
    let score = |folders: &[&str]| {
        let renders = tempfile::tempdir_in(root.path()).unwrap();
        for folder in folders {
            std::fs::create_dir_all(renders.path().join(folder)).unwrap();
            std::fs::write(renders.path().join(folder).join("000005.png"), encode_png(&image(0, 5)).unwrap()).unwrap();
        }
        let walls = Walls { keys: vec!["room".to_owned()], ..Walls::new(0, 8) };
        let data = dataset(walls, &[entry(&[0, 4], &[5]), entry(&[0, 6], &[5])]);
        let run = Run::new(vec![data], vec![Arc::new(Renders::new(renders.path(), Some("theirs")).unwrap())]);
        let found = run.plan().find_imported_files().map(drop).map_err(|error| error.to_string());
        let (results, _) = run.run(&renders.path().join("store")).unwrap();
        let details = results.targets.into_iter().map(|row| row.detail.unwrap_or_default());
        let short = |text: String| text.replace(&renders.path().display().to_string(), "renders");
        (found.map_err(short), details.map(short).collect::<Vec<_>>())
    };
    let needed = |entry: usize| {
        format!(
            "no file for frame 5 of scene room: an index of this run has 2 entries of the scene: entry {entry} \
             needs room-{entry}/000005.png, .exr or .npy below renders"
        )
    };
    let found = String::new;
    assert_eq!(score(&["room-0", "room-1"]), (Ok(()), vec![found(), found()]));
    assert_eq!(score(&["room-0", "room"]), (Ok(()), vec![found(), needed(1)]));
    assert_eq!(score(&["room", "room-1"]).1, [needed(0), found()]);
    let (refused, details) = score(&["room"]);
    assert_eq!(details, [needed(0), needed(1)]);
    let refused = refused.unwrap_err();
    let example = "where SCENE is, for example, room-0, for the first of the 2 entries that an index of this run has \
                   of room, found";
    assert!(refused.contains(example) && refused.ends_with("the folder contains room"), "{refused}");
}

/// `room-0` is the first entry of `room`, and the scene `room-0` is in `room-0-0`.
#[test]
fn kept_images_of_such_scenes_can_be_scored() {
    let root = tempfile::tempdir().unwrap();
    let keeping = Run { images: KeepImages::All, ..run_of(&ROOMS, Arc::new(NearestView)) };
    let (expected, _) = keeping.run(&root.path().join("store")).unwrap();
    let kept = root.path().join("store/images/walls/nearest-view");
    assert!(kept.join("room-0").is_dir() && kept.join("room-0-0").is_dir());
    let scored = |name: &str| {
        let run = run_of(&ROOMS, Arc::new(Renders::new(&kept, None).unwrap()));
        run.run(&root.path().join(name)).unwrap().0
    };
    let hashes = |results: &Results| results.targets.iter().map(|row| row.render_hash.clone()).collect::<Vec<_>>();
    let all = hashes(&expected);
    assert!(all.iter().all(Option::is_some) && all[0] != all[1], "two scenes: {all:?}");
    assert_eq!(hashes(&scored("all")), all);
    std::fs::remove_dir_all(kept.join("room-0-0")).unwrap();
    assert_eq!(hashes(&scored("part")), [all[0].clone(), None]);
}

#[test]
fn gaussians_of_a_scene_are_not_those_of_another_whose_name_is_its_entry() {
    let root = tempfile::tempdir().unwrap();
    write_gaussian(&root.path().join("room-0.ply"));
    let run = |keys: &[&str], store: &str| {
        let ply = Ply::new(root.path(), None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
        let (results, _) = run_of(keys, Arc::new(ply)).run(&root.path().join(store)).unwrap();
        results.trials.iter().map(|trial| trial.detail.clone()).collect::<Vec<_>>()
    };
    assert_eq!(run(&ROOMS[..1], "alone"), [None]);
    let [first, second] = run(&ROOMS, "both").try_into().unwrap();
    let first = first.unwrap();
    assert!(first.starts_with("no Gaussians of scene room: expected room.ply or "), "{first}");
    assert!(first.ends_with("; room-0 is the scene of that name"), "{first}");
    assert_eq!(second, None);
}

fn write_gaussian(path: &Path) {
    let parts = GaussianParts {
        means: vec![[0.4, 0.0, 4.0]],
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![[-1.0; 3]],
        opacity_logits: vec![2.0],
        sh: vec![[1.0; 3]],
        ..GaussianParts::default()
    };
    files::write(path, &Gaussians::new(parts).unwrap(), Output::Ply(Encoding::Ascii)).unwrap();
}

/// What a scene's second folder contains may be what the method wrote last. A link that leads back to itself can be read by nobody.
#[cfg(unix)]
#[test]
fn a_scene_with_a_folder_that_cannot_be_read_fails_for_that_reason() {
    let root = tempfile::tempdir().unwrap();
    let [renders, gaussians] = ["renders", "gaussians"].map(|name| root.path().join(name));
    std::fs::create_dir_all(renders.join("room")).unwrap();
    std::fs::write(renders.join("room/000005.png"), encode_png(&image(0, 5)).unwrap()).unwrap();
    std::os::unix::fs::symlink("color", renders.join("room/color")).unwrap();
    let run = run_of(&ROOMS[..1], Arc::new(Renders::new(&renders, None).unwrap()));
    let system = std::fs::read_dir(renders.join("room/color")).unwrap_err();
    let why = format!("{system} ({})", renders.join("room/color").display());
    let refused = run.plan().find_imported_files().unwrap_err().to_string();
    assert!(refused.ends_with(&format!("none of 1 scenes there that can be read: {why}")), "{refused}");
    let (results, _) = run.run(&root.path().join("rendered")).unwrap();
    assert_eq!(results.targets[0].detail.as_deref(), Some(why.as_str()));

    std::fs::create_dir(&gaussians).unwrap();
    write_gaussian(&gaussians.join("room.ply"));
    std::os::unix::fs::symlink("room", gaussians.join("room")).unwrap();
    let ply = Ply::new(&gaussians, None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
    let (results, _) = run_of(&ROOMS[..1], Arc::new(ply.clone())).run(&root.path().join("drawn")).unwrap();
    let why = format!("{system} ({})", gaussians.join("room/gaussians.ply").display());
    assert_eq!(results.trials[0].detail.as_deref(), Some(why.as_str()));
    std::fs::remove_file(gaussians.join("room.ply")).unwrap();
    let refused = run_of(&ROOMS[..1], Arc::new(ply)).plan().find_imported_files().unwrap_err().to_string();
    assert!(refused.ends_with(&format!("none of 1 scenes there that can be read: {why}")), "{refused}");
}

/// Of two iterations that 3DGS has saved, either may be meant.
#[test]
fn the_folder_of_3dgs_is_read_unless_it_has_several_iterations() {
    let root = tempfile::tempdir().unwrap();
    let gaussians = root.path().join("gaussians");
    let path = |iteration: &str| gaussians.join("room/point_cloud").join(iteration).join("point_cloud.ply");
    let write = |iteration: &str| {
        std::fs::create_dir_all(path(iteration).parent().unwrap()).unwrap();
        write_gaussian(&path(iteration));
    };
    let found = |store: &str| {
        let ply = Ply::new(&gaussians, None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
        let run = run_of(&ROOMS[..1], Arc::new(ply));
        let found = run.plan().find_imported_files().unwrap()[0].to_string();
        let (results, _) = run.run(&root.path().join(store)).unwrap();
        (found, results.trials[0].detail.clone())
    };
    write("iteration_7000");
    let (files, detail) = found("one");
    assert!(files.ends_with(": SCENE/point_cloud/iteration_7000/point_cloud.ply (1)"), "{files}");
    assert_eq!(detail, None);
    write("iteration_30000");
    let [last, first] = ["iteration_30000", "iteration_7000"].map(|iteration| path(iteration).display().to_string());
    assert_eq!(found("two").1, Some(format!("two files of Gaussians of scene room: {last} and {first}")));
}

/// None of the scenes that are looked for first has files.
#[test]
fn a_folder_with_one_of_many_scenes_is_accepted() {
    let keys: Vec<String> = (0..200).map(|scene| format!("wall-{scene}")).collect();
    let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
    let folder = tempfile::tempdir().unwrap();
    let files = || {
        let run = run_of(&keys, Arc::new(Renders::new(folder.path(), Some("theirs")).unwrap()));
        run.plan().find_imported_files().map(|found| found[0].to_string()).map_err(|error| error.to_string())
    };
    let none = files().unwrap_err();
    assert!(none.contains("none of 200 scenes there; the folder contains nothing"), "{none}");
    std::fs::create_dir(folder.path().join("wall-1")).unwrap();
    std::fs::write(folder.path().join("wall-1/000005.png"), encode_png(&image(1, 5)).unwrap()).unwrap();
    let one = files().unwrap();
    assert!(one.ends_with(": SCENE/000029.png (1); 199 of 200 scenes are missing"), "{one}");
}

/// `haal` is `hall`, misspelt.
#[test]
fn folders_of_no_scene_are_named_where_scenes_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["haal", "room-0"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
        std::fs::write(folder.path().join(name).join("000005.png"), encode_png(&image(0, 5)).unwrap()).unwrap();
    }
    for (keys, end) in [
        (&["room", "hall"][..], "; 1 of 2 scenes are missing; of no scene: haal"),
        (&["room", "hall", "haal/1"], "; 2 of 3 scenes are missing"),
        (&["room"], ""),
    ] {
        let run = run_of(keys, Arc::new(Renders::new(folder.path(), Some("theirs")).unwrap()));
        let found = run.plan().find_imported_files().unwrap()[0].to_string();
        assert!(found.ends_with(&format!(": SCENE-0/000029.png (1){end}")), "{keys:?}: {found}");
    }
}

/// The images of one folder, scored under protocols of two and three views.
#[test]
fn files_that_serve_protocols_with_other_context_views_are_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    for scene in 0..2 {
        let of_scene = folder.path().join(format!("renders/wall-{scene}"));
        std::fs::create_dir_all(&of_scene).unwrap();
        std::fs::write(of_scene.join("000005.png"), encode_png(&image(scene, 5)).unwrap()).unwrap();
    }
    let two = || dataset(Walls::new(2, 8), &[entry(&[0, 4], &[5])]);
    let named = |name: &str, data: Dataset| Dataset { name: name.to_owned(), ..data };
    let warnings = |store: &str, datasets: Vec<Dataset>| {
        let renders: Arc<dyn Method> = Arc::new(Renders::new(&folder.path().join("renders"), Some("theirs")).unwrap());
        let (results, _) = Run::new(datasets, vec![renders]).run(&folder.path().join(store)).unwrap();
        let found = results.provenance.warnings.into_iter();
        let found = found.filter(|warning| warning.kind.starts_with("scenes whose files serve "));
        found.map(|warning| (warning.preset, warning.count, warning.example)).collect::<Vec<_>>()
    };
    let three = named("three", dataset(Walls::new(2, 8), &[entry(&[0, 2, 4], &[5])]));
    let expected = [
        ("three".to_owned(), 2, "wall-0, entry 0: frames 0, 2, 4, and 0, 4 under walls".to_owned()),
        ("walls".to_owned(), 2, "wall-0, entry 0: frames 0, 4, and 0, 2, 4 under three".to_owned()),
    ];
    assert_eq!(warnings("both", vec![two(), three]), expected);
    assert!(warnings("same", vec![two(), named("again", two())]).is_empty());
}
