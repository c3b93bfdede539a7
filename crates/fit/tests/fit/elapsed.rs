//! The time of a run that was resumed.

use atsplat_fit::{Fit, FitDevice, Strategy};

use crate::common::{config, rewrite_metadata, run, start, views};

#[test]
fn a_resumed_run_goes_on_counting_its_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let (views, start, config) = (views().0, start(Strategy::Fixed, 50), config(Strategy::Fixed, 50));
    let mut fit = Fit::new(config.clone(), views.clone(), &start).unwrap();
    run(&mut fit, 5);
    let before = fit.elapsed();
    assert!(before.seconds > 0.0 && before.since_step == 0, "{before:?}");
    fit.checkpoint(&path).unwrap();
    let resumed = || {
        let fit = Fit::resume(config.clone(), views.clone(), &[], &start, FitDevice::default(), &path);
        fit.map(|fit| fit.elapsed())
    };
    let found = resumed().unwrap();
    assert!(found.seconds > before.seconds && found.since_step == 0, "{found:?} after {before:?}");
    rewrite_metadata(&path, r#"\"since-step\":0"#, r#"\"since-step\":6"#);
    let error = resumed().unwrap_err().to_string();
    assert!(error.starts_with("checkpoint: elapsed: expected the time of a run"), "{error}");
    // As before checkpoints had a time.
    rewrite_metadata(&path, r#"\"elapsed\":"#, r#"\"elapsee\":"#);
    assert_eq!(resumed().unwrap().since_step, 5);
}
