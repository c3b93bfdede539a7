//! Tests of which images of trials a page contains.

use atsplat_results::store::images::image_path;
use atsplat_results::{Results, TargetRow, TargetStatus};

use super::tests::{LABEL, Sample, write_image};
use super::*;
use crate::sample::{SCENES, atsplat, preset, results_over};

#[test]
fn the_page_is_no_larger_than_allowed_and_omitted_images_are_counted() {
    let sample = Sample::new();
    let images = |page: &str| -> usize {
        page.match_indices("data:image/png").map(|(at, _)| page[at..].find('"').unwrap()).sum()
    };
    let page = sample.write(usize::MAX, None);
    let all = images(&page);
    assert!(all > 10_000 && page.contains("66 of 66 images"), "{all}");
    let shorter = sample.write(page.len() - 1, None);
    assert!(shorter.len() < page.len() && images(&shorter) > all * 9 / 10, "{} of {all}", images(&shorter));
    let size = page.len() - all / 2;
    let page = sample.write(size, None);
    let some = images(&page);
    assert!(page.len() <= size && some < all * 2 / 3 && some > all / 3, "{some} of {all}, {} of {size}", page.len());
    assert!(page.contains("would make it too large"));
    let page = sample.write(0, None);
    assert!(images(&page) == 0 && page.contains("0 of 66 images"));
}

#[test]
fn the_worst_and_the_best_trials_have_images_before_others() {
    the_worst_and_the_best_come_first(&Sample::new());
    let mut truncated = Sample::new();
    for row in &mut truncated.results.targets {
        row.scores = row.scores.iter().map(|(id, score)| (id.replace("psnr", "psnr-8bit-truncated"), *score)).collect();
    }
    the_worst_and_the_best_come_first(&truncated);
}

fn the_worst_and_the_best_come_first(sample: &Sample) {
    let whole = sample.write(usize::MAX, None);
    let all: usize = whole.match_indices("data:image/png").map(|(at, _)| whole[at..].find('"').unwrap()).sum();
    let page = sample.write(whole.len() - all / 2, None);
    let (_, data) = page.split_once("id=\"data\">").unwrap();
    let data: Value = serde_json::from_str(data.split_once("</script>").unwrap().0).unwrap();
    let runs = data["runs"].as_array().unwrap();
    // By rising quality; all methods are best on the first scene.
    let counts = SCENES.iter().rev().map(|scene| {
        let trials = runs.iter().flat_map(|run| run["trials"].as_array().unwrap());
        trials.filter(|trial| trial["scene"] == *scene).map(|trial| trial["images"].as_array().unwrap().len()).sum()
    });
    let counts: Vec<usize> = counts.collect();
    assert_eq!(counts[0], 18, "the worst: {counts:?}");
    assert!(counts[3] > counts[1] && counts[1] < 12, "the best before the second worst: {counts:?}");
}

/// Three images of a hundred bytes each: one byte too many costs one of them, at once.
#[test]
fn a_page_that_is_a_little_too_large_is_written_only_once_more() {
    let mut budgets = Vec::new();
    let page = fitted(1299, |budget| {
        budgets.push(budget);
        let images = (budget / 100).min(3) * 100;
        Ok::<_, ReportError>(("x".repeat(1000 + images), images))
    });
    assert_eq!((page.unwrap().len(), budgets), (1200, vec![1299, 299]));
}

/// Tables and plots of a thousand bytes, and images of a hundred.
#[test]
fn a_page_with_little_room_for_images_has_a_few_of_them() {
    let sizes = |limit| {
        let mut budgets = Vec::new();
        let page = fitted(limit, |budget| {
            budgets.push(budget);
            let images = (budget / 100).min(9) * 100;
            Ok::<_, ReportError>(("x".repeat(1000 + images), images))
        });
        (page.unwrap().len(), budgets)
    };
    assert_eq!(sizes(960), (1100, vec![960, 120]), "one of a hundred, although none fits");
    assert_eq!(sizes(1000), (1100, vec![1000, 125]), "one, although the page would fit without it");
    assert_eq!(sizes(1120), (1100, vec![1120, 120]), "one fits, in less than an eighth");
    assert_eq!(sizes(700), (1000, vec![700, 87]), "an eighth has no room for one");
}

/// The order in which trials get room, by their numbers in `results`; the `stored` ones have renders.
fn order(results: &Results, stored: &[usize]) -> Vec<usize> {
    let number = |row: &TargetRow| results.trials.iter().position(|trial| trial.key == row.key).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for row in results.targets.iter().filter(|row| stored.contains(&number(row))) {
        write_image(&image_path(folder.path(), &row.key, row.frame), row.target, 0);
    }
    let store = PageStore { source: Source { label: LABEL, results }, folder: Some(folder.path()) };
    let mut order: Vec<usize> = images::in_turns(&[store]).into_iter().map(|(_, row)| number(row)).collect();
    order.dedup();
    order
}

/// Ten trials from the best to the worst.
#[test]
fn only_trials_with_scores_and_renders_are_worst_best_or_typical() {
    let mut results = results_over(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ())], 10);
    assert_eq!(order(&results, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]), [9, 0, 4, 8, 7, 6, 5, 3, 2, 1]);
    assert_eq!(order(&results, &[1, 3, 7, 8, 9]), [9, 1, 3, 8, 7], "the third is nearest the median");
    let failed = results.trials[5].key.clone();
    for row in results.targets.iter_mut().filter(|row| row.key == failed) {
        row.status = TargetStatus::Failed;
        row.scores.clear();
    }
    assert_eq!(order(&results, &[0, 1, 2, 3, 4, 6, 7, 8, 9]), [9, 0, 4, 8, 7, 6, 3, 2, 1], "without renders");
    assert_eq!(order(&results, &[0, 4, 5, 9]), [9, 0, 4, 5], "refused renders");
}

#[test]
fn files_that_are_not_images_are_not_embedded() {
    let sample = Sample::new();
    let row = &sample.results.targets[0];
    std::fs::write(image_path(sample.folder.path(), &row.key, row.frame), "\u{89}PNG\r\n<script>").unwrap();
    assert!(sample.write(usize::MAX, None).contains("1 cannot be read"));
}

#[test]
fn images_of_other_results_are_not_shown() {
    let mut sample = Sample::new();
    let row = sample.results.targets[0].clone();
    let path = image_path(sample.folder.path(), &row.key, row.frame);
    let png = std::fs::read(&path).unwrap();
    let (header, rest) = png.split_at(33);
    // The text says which row the image belongs to.
    let text = b"\0\0\0\x11tEXtatsplat-samples\0x\x4d\xaa\x05\x2e";
    std::fs::write(&path, [header, &text[..], rest].concat()).unwrap();
    let mut said = |hash: &str| {
        sample.results.targets[0].render_hash = Some(hash.to_owned());
        sample.write(usize::MAX, None).contains("1 belong to results that were replaced")
    };
    assert_eq!((said("x"), said("y")), (false, true));
}

/// One of a scene's two context images is none; it counts once, although three methods saw it.
#[test]
fn context_images_that_are_left_out_are_counted() {
    let sample = Sample::new();
    let key = sample.results.targets[0].key.of_method("context");
    let paths = [0, 30].map(|frame| image_path(sample.folder.path(), &key, frame));
    for path in &paths {
        write_image(path, 1, 2);
    }
    let source = Source { label: LABEL, results: &sample.results };
    let store = PageStore { source, folder: Some(sample.folder.path()) };
    let summary = || images::Album::fill(&mut ImageFiles::default(), &[store], usize::MAX).summary();
    assert!(summary().starts_with("66 of 66 images") && !summary().contains("context"), "{}", summary());
    std::fs::write(&paths[1], "no image").unwrap();
    assert!(summary().contains(" 1 context image left out"), "{}", summary());
}

/// A page is written several times until it is small enough.
#[test]
fn a_page_that_is_written_again_reads_no_image_again() {
    let sample = Sample::new();
    let source = Source { label: LABEL, results: &sample.results };
    let store = PageStore { source, folder: Some(sample.folder.path()) };
    let row = &sample.results.targets[0];
    let render = image_path(sample.folder.path(), &row.key, row.frame);
    let mut files = ImageFiles::default();
    let filled = |files: &mut ImageFiles| {
        let album = images::Album::fill(files, &[store], usize::MAX);
        let uris: Vec<String> = album.uris(files).into_iter().map(str::to_owned).collect();
        (album.summary(), uris)
    };
    let first = filled(&mut files);
    std::fs::write(&render, "no image").unwrap();
    assert!(filled(&mut files) == first && first.0.starts_with("66 of 66 images"), "{}", first.0);
    let anew = filled(&mut ImageFiles::default());
    assert!(anew.0.contains(" 1 cannot be read."), "{}", anew.0);
}

/// A megabyte that is none, on a page of half of it.
#[test]
fn an_image_that_does_not_fit_is_not_read() {
    let sample = Sample::new();
    let row = &sample.results.targets[0];
    std::fs::write(image_path(sample.folder.path(), &row.key, row.frame), vec![7; 1_000_000]).unwrap();
    let source = Source { label: LABEL, results: &sample.results };
    let store = PageStore { source, folder: Some(sample.folder.path()) };
    let summary = |budget| images::Album::fill(&mut ImageFiles::default(), &[store], budget).summary();
    assert!(summary(usize::MAX).contains(" 1 cannot be read."), "{}", summary(usize::MAX));
    assert!(summary(500_000).ends_with(" 1 would make it too large."), "{}", summary(500_000));
}
