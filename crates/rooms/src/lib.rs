//! Procedural simulated scenes: rooms and yards made from a seed and ray traced along trajectories with the motion
//! statistics of RE10K, with true depth, normals and instances. Independent of models.
//!
//! The same [`Request`] gives the same bytes on any number of threads. The world is in metres with z up; cameras have
//! OpenCV's axes.

#[cfg(test)]
mod analytic_tests;
mod build;
mod bvh;
mod cost_summary;
mod costs;
mod covisibility;
mod dataset;
mod effects;
mod error;
#[cfg(test)]
mod fingerprint_tests;
#[cfg(test)]
mod image_tests;
mod lamp;
mod material;
pub mod motion_report;
mod noise;
mod path;
mod ray_packet;
mod render;
mod rng;
mod sampling;
mod seed;
mod shape;
mod simulation;
mod sky;
mod source;
mod tiled_light;
mod world;

pub use cost_summary::{CostSummary, EffectMillis};
pub use costs::{EffectCost, FrameCosts, ImageDifference, Timing};
pub use covisibility::Covisibility;
pub use dataset::{ImageEncoding, Layout, ManifestScene, WriteOptions, encoded_scene, write_dataset};
pub use effects::{AbsentEffect, ActiveEffect, EffectChoice, EffectKind};
pub use error::RoomsError;
pub use path::{ClipMotion, Motion, Shot};
pub use render::Geometry;
pub use seed::{SceneKind, SceneSeed, Split};
pub use simulation::{GENERATION, GENERATOR, Request, Route, Simulation};
pub use source::SimulatedScenes;
