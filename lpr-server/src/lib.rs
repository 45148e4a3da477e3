//! The `lpr` command line, the server of training jobs, and what both need of the outside world:
//! files, pictures and logs.
//!
//! [`lpr_core`] does the work and never touches a file; everything here reads its input, calls it
//! and writes the result.

pub mod animation;
pub mod api;
pub mod artist;
pub mod cli;
pub mod episode;
pub mod files;
pub mod formats;
pub mod gallery;
pub mod images;
pub mod jobs;
pub mod metrics;
pub mod moments;
pub mod problems;
pub mod run_directory;
pub mod run_options;
pub mod scene_file;
pub mod signals;
pub mod tensorboard;
