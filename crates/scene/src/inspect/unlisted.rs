//! Images next to those of a capture that none of its frames names.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::files::{DYNAMIC_MASK, ImageListing, split_image_name};
use crate::{Scene, WarningKind, Warnings};

/// Counts the images in the folders of a capture's images that belong to no frame: structure from motion places some only, and lists
/// are cut. They harm nothing, so only inspections look for them; those of trajectories, which state no size of images, are found
/// when a scene is loaded. A folder that cannot be listed has none.
pub(super) fn report_unlisted(scene: &Scene, warnings: &mut Warnings) {
    if scene.frames.iter().any(|frame| frame.stated_size.is_none()) {
        return;
    }
    let mut names_in: BTreeMap<&Path, BTreeSet<&str>> = BTreeMap::new();
    for path in scene.frames.iter().filter_map(|frame| frame.image.in_source().file()) {
        let name = path.file_name().and_then(|name| name.to_str());
        if let (Some(folder), Some((stem, _))) = (path.parent(), name.and_then(split_image_name)) {
            names_in.entry(folder).or_default().insert(stem);
        }
    }
    for (folder, listed) in names_in {
        let Ok(Some(listing)) = ImageListing::read(folder) else { continue };
        let is_other = |stem: &&str| !listed.contains(stem) && !stem.starts_with(DYNAMIC_MASK);
        for path in listing.stems().filter(is_other).filter_map(|stem| listing.by_stem(stem)) {
            let detail = format!("no frame belongs to {}", path.display());
            warnings.push(WarningKind::UnlistedImage, &scene.key, detail);
        }
    }
}
