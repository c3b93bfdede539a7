use std::path::PathBuf;

use atsplat_camera::{Camera, ImageSize};
use atsplat_scene::camera_file::CameraRecord;
use atsplat_splat::{Exposure, RenderOptions, View};
use serde::Serialize;

/// One image to render.
#[derive(Clone, Debug)]
pub struct FrameRequest {
    /// Number in its file names.
    pub number: usize,
    /// Name of the view.
    pub name: String,
    /// Camera and size.
    pub view: View,
    /// Applied after compositing.
    pub exposure: Option<Exposure>,
}

impl FrameRequest {
    /// Requests of one size without exposure, numbered and named from 0.
    pub fn numbered(cameras: Vec<Camera>, size: ImageSize) -> Vec<Self> {
        let request = |(number, camera): (usize, Camera)| Self {
            number,
            name: number.to_string(),
            view: View { camera, size },
            exposure: None,
        };
        cameras.into_iter().enumerate().map(request).collect()
    }

    /// The camera as recorded in `render.json`.
    pub fn record(&self) -> CameraRecord {
        let exposure = self.exposure.map(|exposure| exposure.to_3dgs());
        CameraRecord::new(self.number, self.name.clone(), &self.view.camera, self.view.size, exposure)
    }

    /// The same options with the exposure of this request.
    pub fn exposed(&self, options: &RenderOptions) -> RenderOptions {
        RenderOptions { exposure: self.exposure, ..options.clone() }
    }
}

/// The images to render, and where their cameras come from.
#[derive(Debug)]
pub struct RenderPlan {
    /// The images.
    pub requests: Vec<FrameRequest>,
    /// Where the cameras come from.
    pub path: PathRecord,
    /// Warnings.
    pub notes: Vec<String>,
}

/// Where the cameras come from. Angles are in degrees, lengths in scene units.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
#[expect(missing_docs, reason = "fields of `render.json` with the names of the options")]
pub enum PathRecord {
    /// Those of a file.
    Cameras { file: PathBuf },
    /// A circle around the scene.
    Orbit {
        target: [f64; 3],
        up: [f64; 3],
        distance: f64,
        /// Radius of the sphere that the field of view just contains.
        framed_radius: f64,
        elevation_degrees: f64,
        azimuth_degrees: f64,
        sweep_degrees: f64,
    },
    /// A smooth path through the cameras of a file.
    Spline {
        file: PathBuf,
        /// Number of cameras that the path goes through.
        keys: usize,
        closed: bool,
        spacing: PathSpacing,
    },
}

/// How views are spaced on a path through the cameras of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathSpacing {
    /// Evenly by the distance that the camera travels.
    ArcLength,
    /// Evenly in time, by the times that the file records.
    Time,
    /// As many views between any two adjacent cameras.
    Even,
}
