//! The directory in which a server keeps its jobs; one server at a time.

use crate::files::{FileError, Result};
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

/// A directory that belongs to this process until it is dropped.
#[derive(Debug)]
pub struct DataDirectory {
    path: PathBuf,
    /// Locked: the operating system lets go of it when the process ends, however it ends.
    _lock: File,
}

impl DataDirectory {
    /// Opens the directory at `path`, which is created where it is absent.
    ///
    /// # Errors
    ///
    /// When it is a file, cannot be written, or belongs to another server.
    pub fn open(path: &Path) -> Result<Self> {
        fs::create_dir_all(path).map_err(FileError::io("create", path))?;
        let path = fs::canonicalize(path).map_err(FileError::io("read", path))?;
        let lock = path.join("lock");
        let file = File::create(&lock).map_err(FileError::io("create", &lock))?;
        match file.try_lock() {
            Ok(()) => Ok(Self { path, _lock: file }),
            Err(TryLockError::WouldBlock) => Err(FileError::content(
                &path,
                "another server uses this directory: stop it, or choose another --data-dir",
            )),
            Err(TryLockError::Error(error)) => Err(FileError::io("lock", &lock)(error)),
        }
    }

    /// The file of the database.
    #[must_use]
    pub fn database(&self) -> PathBuf {
        self.path.join("lpr.sqlite")
    }

    /// Directory of the jobs' folders.
    #[must_use]
    pub fn jobs(&self) -> PathBuf {
        self.path.join("jobs")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_server_is_refused_until_the_first_has_ended() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data");
        let first = DataDirectory::open(&path).unwrap();
        let error = DataDirectory::open(&path).unwrap_err().to_string();
        assert!(error.contains("another server uses this directory"), "{error}");
        drop(first);
        DataDirectory::open(&path).unwrap();
    }

    #[test]
    fn a_file_is_no_data_directory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data");
        fs::write(&path, "mine").unwrap();
        let error = DataDirectory::open(&path).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: cannot create", path.display())), "{error}");
    }
}
