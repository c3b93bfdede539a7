//! Events of the libraries on standard error.

use crate::common::{atsplat, succeed, write_trajectory};

#[test]
fn events_are_printed_only_if_asked_for_and_change_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_trajectory(&here.join("walk.txt"), 20);
    let inspect = ["data", "inspect", "walk.txt"];
    let plain = atsplat(here, &inspect);
    assert_eq!(succeed(here, &inspect), plain.stdout);
    assert!(!plain.stderr.contains("opened dataset"), "{}", plain.stderr);

    let (opened, loaded) = ("INFO atsplat_scene::open: opened dataset path=walk.txt format=re10k scenes=1", "loading");
    for (options, has_opened, has_loaded) in [
        (["-v"].as_slice(), true, false),
        (&["-vv"], true, true),
        (&["--log", "atsplat_scene=debug"], true, true),
        (&["--log", "atsplat_scene=info,atsplat_eval=debug"], true, false),
        (&["--log", "atsplat_eval=debug"], false, false),
    ] {
        let outcome = atsplat(here, &[options, &inspect].concat());
        assert_eq!((outcome.code, &outcome.stdout), (0, &plain.stdout), "{options:?}");
        assert_eq!(outcome.stderr.contains(opened), has_opened, "{options:?}: {}", outcome.stderr);
        assert_eq!(outcome.stderr.contains(loaded), has_loaded, "{options:?}: {}", outcome.stderr);
        let rest: Vec<&str> = outcome.stderr.lines().filter(|line| !line.contains("atsplat_scene")).collect();
        assert_eq!(rest, plain.stderr.lines().collect::<Vec<_>>(), "{options:?}");
    }
}

#[test]
fn a_filter_that_matches_nothing_is_a_usage_error() {
    let folder = tempfile::tempdir().unwrap();
    for (filter, expected) in [
        ("scene=debug", "parts that begin with atsplat"),
        ("atsplat_scene=loud", "atsplat_scene=loud"),
        ("atsplat_scene=debug,atsplat_evl=debug", "found \"atsplat_evl\""),
    ] {
        atsplat(folder.path(), &["--log", filter, "protocol", "list"]).says(2, expected);
    }
    assert_eq!(atsplat(folder.path(), &["-v", "--log", "debug", "protocol", "list"]).code, 2);
}
