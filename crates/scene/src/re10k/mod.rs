//! RealEstate10K: camera trajectories as text, with or without the video's frames.

mod frames;
mod naming;
mod open;
mod source;
mod trajectory;

pub use source::{Re10kOptions, Re10kScenes};
pub use trajectory::{Trajectory, TrajectoryRow, parse_trajectory, read_trajectory, write_trajectory};

pub(crate) use open::READER;
pub(crate) use source::{trajectory_files, trajectory_key};
pub(crate) use trajectory::starts_like_a_trajectory;
