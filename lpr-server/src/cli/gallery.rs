//! `lpr gallery`: every task as a picture and as an animation, and the page that lists them.

use super::failure::Result;
use crate::files;
use crate::gallery::{self, GalleryError};
use core::fmt;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// A new directory for the pictures; the page is DIR.md beside it
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    directory: PathBuf,
    page: PathBuf,
    tasks: usize,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let directory = arguments.out.clone();
    let page = directory.with_extension("md");
    let mut entries = Vec::new();
    files::write_directory_atomically::<GalleryError>(&directory, |partial| {
        entries = gallery::draw(partial)?;
        Ok(())
    })?;
    let name = directory.file_name().unwrap_or_default().to_string_lossy();
    gallery::write_page(&page, &name, &entries)?;
    Ok(Report { directory, page, tasks: entries.len() })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {} tasks, pictures in {}",
            self.page.display(),
            self.tasks,
            self.directory.display()
        )
    }
}
