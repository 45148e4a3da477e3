//! The lines that a run adds to `metrics.jsonl`.

use super::event::Point;
use crate::files::{FileError, Result};
use crate::metrics;
use std::io::{self, SeekFrom};
use std::path::{Path, PathBuf};
use tokio::fs::File;
use tokio::io::{AsyncReadExt as _, AsyncSeekExt as _};

/// A place in a growing file. The file is opened anew each time: a run that resumes puts one with
/// the same lines in its place.
#[derive(Debug)]
pub(super) struct Tail {
    path: PathBuf,
    /// Bytes that have been read.
    offset: u64,
}

impl Tail {
    /// The place after the first `n_lines`, or at the end of a shorter file.
    pub(super) async fn after(path: PathBuf, n_lines: u64) -> Result<Self> {
        let text = whole_lines(&path, 0).await?;
        let n_lines = usize::try_from(n_lines).unwrap_or(usize::MAX);
        let offset = text.split_inclusive('\n').take(n_lines).map(str::len).sum::<usize>() as u64;
        Ok(Self { path, offset })
    }

    /// The points of the lines that have been added since; one that is being written comes later.
    pub(super) async fn read(&mut self) -> Result<Vec<Point>> {
        let text = whole_lines(&self.path, self.offset).await?;
        self.offset += text.len() as u64;
        text.lines().map(|line| self.point(line)).collect()
    }

    fn point(&self, line: &str) -> Result<Point> {
        let env_steps = metrics::env_step(line)
            .ok_or_else(|| FileError::content(&self.path, format!("no log point: {line}")))?;
        Ok(Point { env_steps, line: line.to_owned() })
    }
}

/// The lines of a file from a byte on that have been ended; none of a file that is absent.
async fn whole_lines(path: &Path, offset: u64) -> Result<String> {
    let mut bytes = match read_from(path, offset).await {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
        bytes => bytes.map_err(FileError::io("read", path))?,
    };
    bytes.truncate(bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1));
    String::from_utf8(bytes).map_err(|error| FileError::content(path, error.to_string()))
}

async fn read_from(path: &Path, offset: u64) -> io::Result<Vec<u8>> {
    let mut file = File::open(path).await?;
    file.seek(SeekFrom::Start(offset)).await?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).await?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn steps(points: &[Point]) -> Vec<u64> {
        points.iter().map(|point| point.env_steps).collect()
    }

    #[tokio::test]
    async fn a_line_is_read_once_and_when_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let mut tail = Tail::after(path.clone(), 0).await.unwrap();
        assert_eq!(tail.read().await.unwrap(), []);
        fs::write(&path, "{\"env_steps\":0}\n{\"env_steps\":1}\n{\"env_st").unwrap();
        assert_eq!(steps(&tail.read().await.unwrap()), [0, 1]);
        assert_eq!(tail.read().await.unwrap(), []);
        fs::write(&path, "{\"env_steps\":0}\n{\"env_steps\":1}\n{\"env_steps\":2}\n").unwrap();
        assert_eq!(steps(&tail.read().await.unwrap()), [2]);
    }

    #[tokio::test]
    async fn reading_goes_on_after_the_lines_that_are_known() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        fs::write(&path, "{\"env_steps\":0}\n{\"env_steps\":11}\n{\"env_steps\":2}\n").unwrap();
        let mut tail = Tail::after(path.clone(), 2).await.unwrap();
        assert_eq!(steps(&tail.read().await.unwrap()), [2]);
        assert_eq!(Tail::after(path, 9).await.unwrap().read().await.unwrap(), []);
    }

    #[tokio::test]
    async fn a_line_that_is_no_log_point_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        fs::write(&path, "env_steps 0\n").unwrap();
        let error = Tail::after(path, 0).await.unwrap().read().await.unwrap_err();
        assert!(error.to_string().contains("no log point: env_steps 0"), "{error}");
    }
}
