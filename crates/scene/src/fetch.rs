use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::Scene;

/// Brings the contents of files to this disk before they are read, for datasets whose files are empty here until then.
pub trait Fetch: fmt::Debug + Send + Sync {
    /// Fetches files, and everything in folders. Called from many threads, also for files that are already here. Paths
    /// that are not in the dataset are ignored.
    ///
    /// # Errors
    /// Why contents cannot be fetched. After the first failure every call fails, also one without paths.
    fn fetch(&self, paths: &[PathBuf]) -> io::Result<()>;
}

/// The image files of a scene.
pub(crate) fn image_files(scene: &Scene) -> Vec<PathBuf> {
    scene.frames.iter().filter_map(|frame| frame.image.file()).map(Path::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;
    use std::sync::{Arc, Mutex};

    use atsplat_pixels::ImageU8;
    use tempfile::TempDir;

    use super::*;
    use crate::torch::export_chunks;
    use crate::{ImageFolder, NerfstudioOptions, OpenOptions, SceneSource as _, Warnings, open, open_with};

    const ROWS: &str = "https://youtu.be/x\n1 0.9 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n";
    const POSE: &str = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";

    /// A dataset elsewhere, and a folder with its names, in which files are empty until they are fetched.
    #[derive(Debug)]
    struct Elsewhere {
        there: TempDir,
        here: TempDir,
        fetched: Mutex<Vec<String>>,
    }

    impl Elsewhere {
        fn new(files: &[(&str, &[u8])]) -> Arc<Self> {
            let [there, here] = [(); 2].map(|()| tempfile::tempdir().unwrap());
            for (name, bytes) in files {
                for (folder, bytes) in [(&there, *bytes), (&here, &[][..])] {
                    atsplat_tests::write_file(&folder.path().join(name), bytes);
                }
            }
            Arc::new(Self { there, here, fetched: Mutex::default() })
        }

        fn fetch_below(&self, name: &Path) {
            let path = self.there.path().join(name);
            if path.is_dir() {
                path.read_dir().unwrap().for_each(|entry| self.fetch_below(&name.join(entry.unwrap().file_name())));
            } else if path.is_file() && fs::metadata(self.here.path().join(name)).unwrap().len() == 0 {
                fs::copy(path, self.here.path().join(name)).unwrap();
                self.fetched.lock().unwrap().push(name.display().to_string());
            }
        }

        fn taken(&self) -> Vec<String> {
            let mut fetched = std::mem::take(&mut *self.fetched.lock().unwrap());
            fetched.sort();
            fetched
        }

        /// What opening the dataset fetches, and what loading a scene does.
        fn fetched(self: &Arc<Self>, key: &str, options: OpenOptions) -> [Vec<String>; 2] {
            let options = OpenOptions { fetch: Some(Arc::clone(self) as Arc<dyn Fetch>), ..options };
            let dataset = open_with(self.here.path(), &options, &mut Warnings::new()).unwrap();
            let opening = self.taken();
            let scene = dataset.load(key, &mut Warnings::new()).unwrap();
            for at in 0..scene.frames.len() {
                scene.decode(at, &atsplat_pixels::DecodeLimits::default()).unwrap();
            }
            [opening, self.taken()]
        }
    }

    impl Fetch for Elsewhere {
        fn fetch(&self, paths: &[PathBuf]) -> io::Result<()> {
            for path in paths {
                self.fetch_below(path.strip_prefix(self.here.path()).unwrap());
            }
            Ok(())
        }
    }

    fn png() -> Vec<u8> {
        atsplat_pixels::encode_png(&ImageU8::new(2, 2, vec![9; 12]).unwrap()).unwrap()
    }

    #[test]
    fn trajectories_and_chunks_bring_one_scene() {
        let (rows, png) = (ROWS.as_bytes(), png());
        let files: [(&str, &[u8]); 4] = [("a.txt", rows), ("b.txt", rows), ("a/1.png", &png), ("b/1.png", &png)];
        let trajectories = Elsewhere::new(&files);
        assert_eq!(trajectories.fetched("b", OpenOptions::default()), [vec!["a.txt", "b.txt"], vec!["b/1.png"]]);
        let chunks = tempfile::tempdir().unwrap();
        let mut warnings = Warnings::new();
        let whole = open(trajectories.there.path(), &mut warnings).unwrap();
        export_chunks(&whole, chunks.path(), 1, &mut warnings, &|| ()).unwrap();
        let names = ["000000.torch", "000001.torch", "index.json"];
        let bytes = names.map(|name| fs::read(chunks.path().join(name)).unwrap());
        let chunk = |at: usize| (names[at], bytes[at].as_slice());
        let indexed = Elsewhere::new(&[chunk(0), chunk(1), chunk(2)]);
        assert_eq!(indexed.fetched("b", OpenOptions::default()), [vec!["index.json"], vec!["000001.torch"]]);
        let evaluation: &[u8] = br#"{"b": {"context": [0], "target": [0]}}"#;
        let below = ["test/000000.torch", "test/000001.torch", "test/index.json"];
        let [first, second, index] = [0, 1, 2].map(|at| (below[at], bytes[at].as_slice()));
        let other_index = Elsewhere::new(&[("index.json", evaluation), first, second, index]);
        let expected = [vec!["index.json", "test/index.json"], vec!["test/000001.torch"]];
        assert_eq!(other_index.fetched("b", OpenOptions::default()), expected);
        let unindexed = Elsewhere::new(&[chunk(0), chunk(1)]);
        assert_eq!(unindexed.fetched("b", OpenOptions::default()), [vec!["000000.torch", "000001.torch"], vec![]]);
    }

    /// Lengths in pixels are those of each listed image, angles those of any.
    #[test]
    fn captures_without_sizes_bring_the_listed_images_that_tell_them() {
        let png = png();
        let frame = |name: &str| format!(r#"{{"file_path":"images/{name}.png","transform_matrix":{POSE}}}"#);
        for (lens, listed) in [
            (r#""fl_x":2"#, &["s/images/a.png", "s/images/b.png"][..]),
            (r#""camera_angle_x":1.0"#, &["s/images/a.png"][..]),
        ] {
            let transforms = format!(r#"{{{lens},"frames":[{},{}]}}"#, frame("a"), frame("b"));
            let files: [(&str, &[u8]); 6] = [
                ("s/transforms.json", transforms.as_bytes()),
                ("s/images/a.png", &png),
                ("s/images/b.png", &png),
                ("s/images_8/a.png", &png),
                ("s/images_8/b.png", &png),
                ("t/transforms.json", transforms.as_bytes()),
            ];
            let nerfstudio = NerfstudioOptions { images: ImageFolder::Downscaled(8), ..NerfstudioOptions::default() };
            let [opening, loading] =
                Elsewhere::new(&files).fetched("s", OpenOptions { nerfstudio, ..OpenOptions::default() });
            assert!(opening.is_empty());
            let copies = ["s/images_8/a.png", "s/images_8/b.png", "s/transforms.json"];
            assert_eq!(loading, [listed, &copies[..]].concat(), "{lens}");
        }
    }

    #[test]
    fn captures_bring_the_images_of_the_chosen_size() {
        let png = png();
        let sized =
            format!(r#"{{"w":2,"h":2,"fl_x":2,"frames":[{{"file_path":"images/a.png","transform_matrix":{POSE}}}]}}"#);
        let unsized_ = sized.replace(r#""w":2,"h":2,"#, "");
        for transforms in [&sized, &unsized_] {
            let of = |images| {
                let files: [(&str, &[u8]); 6] = [
                    ("s/transforms.json", transforms.as_bytes()),
                    ("s/images/a.png", &png),
                    ("s/images_8/a.png", &png),
                    ("s/colmap.db", b"large"),
                    ("s/colmap/sparse/0/points3D.bin", b"large"),
                    ("t/transforms.json", transforms.as_bytes()),
                ];
                let nerfstudio = NerfstudioOptions { images, ..NerfstudioOptions::default() };
                let [opening, loading] =
                    Elsewhere::new(&files).fetched("s", OpenOptions { nerfstudio, ..OpenOptions::default() });
                assert!(opening.is_empty());
                loading
            };
            assert_eq!(of(ImageFolder::Listed), ["s/images/a.png", "s/transforms.json"]);
            if transforms == &sized {
                assert_eq!(of(ImageFolder::Downscaled(8)), ["s/images_8/a.png", "s/transforms.json"]);
            }
        }
        let colmap = Elsewhere::new(&[
            ("desk/sparse/0/cameras.txt", b"1 PINHOLE 2 2 4 4 1 1\n"),
            ("desk/sparse/0/images.txt", b"1 1 0 0 0 0 0 0 1 a.png\n\n"),
            ("desk/sparse/0/points3D.txt", b"# none\n"),
            ("desk/images/a.png", &png),
            ("desk/images/b.png", &png),
            ("other/sparse/0/cameras.txt", b"1 PINHOLE 2 2 4 4 1 1\n"),
            ("other/sparse/0/images.txt", b"1 1 0 0 0 0 0 0 1 a.png\n\n"),
        ]);
        let model = ["cameras", "images", "points3D"].map(|name| format!("desk/sparse/0/{name}.txt"));
        let expected = [vec!["desk/images/a.png".to_owned()], model.to_vec()].concat();
        assert_eq!(colmap.fetched("desk", OpenOptions::default()), [vec![], expected]);
    }
}
