//! Files that appear whole or not at all, and bounded reading of versioned JSON.

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Read as _, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Most bytes of JSON that are read from one file, after decompression: 256 MiB, 25 times a long
/// demonstration with images.
pub const MAX_JSON_BYTES: u64 = 256 << 20;

/// End of the names of files and directories that are not whole yet.
pub(crate) const PARTIAL: &str = ".partial";

/// Failure of a file; each message begins with its path.
#[derive(Debug, Error)]
pub enum FileError {
    /// The operating system refused: not found, no permission, disk full.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The attempt: "read", "write", "create".
        action: &'static str,
        /// The file or directory that was asked for.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// The content is not what the format asks for.
    #[error("{}: {reason}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The field at fault and what would be right.
        reason: String,
    },
    /// An output directory that already holds something.
    #[error("{}: is not empty and would be overwritten: choose a new directory", path.display())]
    NotEmpty {
        /// The directory.
        path: PathBuf,
    },
}

/// Result with a [`FileError`].
pub type Result<T, E = FileError> = core::result::Result<T, E>;

impl FileError {
    /// Turns an [`io::Error`] of `action` on `path` into a [`FileError`]; for `map_err`.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// `path` holds something else than its format asks for.
    pub fn content(path: &Path, reason: impl Into<String>) -> Self {
        Self::Content { path: path.to_owned(), reason: reason.into() }
    }
}

/// Writes a file through a sibling that is synced and renamed: readers see the old content or all
/// of the new.
///
/// # Errors
///
/// When the disk is full or `path` cannot be written; nothing is left behind and an older file
/// stays as it was.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<()> {
    replace_file(path, fill).map_err(FileError::io("write", path))
}

fn replace_file(
    path: &Path,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let directory = parent(path);
    let mut builder = tempfile::Builder::new();
    builder.prefix(".").suffix(PARTIAL);
    // The default of 0600 would make results unreadable to others; the process's umask applies to
    // this one.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let partial = builder.tempfile_in(directory)?;
    let mut writer = BufWriter::new(partial.as_file());
    fill(&mut writer)?;
    writer.flush()?;
    drop(writer);
    partial.as_file().sync_all()?;
    partial.persist(path)?;
    sync_directory(directory)
}

/// Makes `path` a directory with the files that `fill` writes into the directory it is given: all
/// of them or none.
///
/// # Errors
///
/// When `path` exists and is not an empty directory, cannot be created, or `fill` fails; nothing is
/// left behind.
pub fn write_directory_atomically<E: From<FileError>>(
    path: &Path,
    fill: impl FnOnce(&Path) -> core::result::Result<(), E>,
) -> core::result::Result<(), E> {
    refuse_non_empty(path)?;
    let directory = parent(path);
    fs::create_dir_all(directory).map_err(FileError::io("create", directory))?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".").suffix(PARTIAL);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    let partial = builder.tempdir_in(directory).map_err(FileError::io("create", path))?;
    fill(partial.path())?;
    sync_directory(partial.path()).map_err(FileError::io("write", path))?;
    fs::rename(partial.path(), path).map_err(FileError::io("create", path))?;
    // It has been renamed: there is nothing left to remove.
    let _ = partial.keep();
    sync_directory(directory).map_err(FileError::io("write", path))?;
    Ok(())
}

/// Creates `path` as an output directory that is filled while the program runs; an empty one may
/// exist.
///
/// # Errors
///
/// When `path` is not an empty directory or cannot be created.
pub fn create_output_directory(path: &Path) -> Result<()> {
    refuse_non_empty(path)?;
    fs::create_dir_all(path).map_err(FileError::io("create", path))
}

/// Checks that an output directory of that name may be created: it is absent or empty.
///
/// # Errors
///
/// When `path` is a file, holds anything, or cannot be looked into.
pub fn refuse_non_empty(path: &Path) -> Result<()> {
    match fs::read_dir(path).map(|mut entries| entries.next().is_some()) {
        Ok(true) => Err(FileError::NotEmpty { path: path.to_owned() }),
        Ok(false) => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(FileError::io("create", path)(error)),
    }
}

/// Removes what [`write_atomically`] and [`write_directory_atomically`] left in `directory` when
/// the program was killed in them.
///
/// # Errors
///
/// When the directory cannot be looked into, or something in it cannot be removed.
pub fn remove_partial(directory: &Path) -> Result<()> {
    for entry in fs::read_dir(directory).map_err(FileError::io("read", directory))? {
        let path = entry.map_err(FileError::io("read", directory))?.path();
        let name = path.file_name().and_then(OsStr::to_str).unwrap_or_default();
        if name.starts_with('.') && name.ends_with(PARTIAL) {
            let removed =
                if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            removed.map_err(FileError::io("delete", &path))?;
        }
    }
    Ok(())
}

/// Reads JSON of at most [`MAX_JSON_BYTES`]; a name that ends in `.gz` is decompressed first.
///
/// # Errors
///
/// When the file is missing, too large, or not a `T`: the message names the field at fault.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    parse_json(path, &read_bounded(path, MAX_JSON_BYTES)?)
}

/// [`read_json`] of a file whose field `version` must be `known_version`.
///
/// # Errors
///
/// As [`read_json`], and when the version is absent or another: that is said before any other field
/// is looked at.
pub fn read_versioned_json<T: DeserializeOwned>(path: &Path, known_version: u32) -> Result<T> {
    let text = read_bounded(path, MAX_JSON_BYTES)?;
    match parse_json::<VersionOnly>(path, &text)?.version {
        Some(version) if version == u64::from(known_version) => parse_json(path, &text),
        Some(version) => Err(FileError::content(
            path,
            format!("version: {version} is unknown, this program reads version {known_version}"),
        )),
        None => {
            Err(FileError::content(path, format!("version: is missing, expected {known_version}")))
        }
    }
}

/// Writes `value` as one line of JSON, atomically; a name that ends in `.gz` is compressed. The
/// same value gives the same bytes.
///
/// # Errors
///
/// When the file cannot be written.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<()> {
    write_atomically(path, |writer| {
        if is_gz(path) {
            let mut encoder = GzEncoder::new(writer, Compression::default());
            serde_json::to_writer(&mut encoder, value)?;
            encoder.finish()?.flush()
        } else {
            serde_json::to_writer(&mut *writer, value)?;
            writer.write_all(b"\n")
        }
    })
}

#[derive(serde::Deserialize)]
struct VersionOnly {
    version: Option<u64>,
}

fn parse_json<T: DeserializeOwned>(path: &Path, text: &[u8]) -> Result<T> {
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let field = error.path().to_string();
        let reason = error.into_inner();
        FileError::content(
            path,
            if field == "." { reason.to_string() } else { format!("{field}: {reason}") },
        )
    })?;
    deserializer.end().map_err(|error| FileError::content(path, error.to_string()))?;
    Ok(value)
}

pub(crate) fn read_bounded(path: &Path, max_bytes: u64) -> Result<Vec<u8>> {
    let file = File::open(path).map_err(FileError::io("read", path))?;
    let reader = BufReader::new(file);
    let mut text = Vec::new();
    // One byte more than allowed tells a file at the limit from one beyond it.
    let read = if is_gz(path) {
        GzDecoder::new(reader).take(max_bytes + 1).read_to_end(&mut text)
    } else {
        reader.take(max_bytes + 1).read_to_end(&mut text)
    };
    read.map_err(FileError::io("read", path))?;
    if text.len() as u64 > max_bytes {
        return Err(FileError::content(path, format!("is larger than {} MiB", max_bytes >> 20)));
    }
    Ok(text)
}

fn is_gz(path: &Path) -> bool {
    path.extension() == Some(OsStr::new("gz"))
}

fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    }
}

/// Makes a rename in `directory` survive a power cut.
fn sync_directory(directory: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(directory)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Record {
        version: u32,
        angles: Vec<f32>,
    }

    fn names(directory: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(directory)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn disk_full() -> io::Error {
        io::Error::from(io::ErrorKind::StorageFull)
    }

    #[test]
    fn a_failed_write_names_the_file_and_leaves_the_old_one() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("summary.json");
        write_atomically(&path, |writer| writer.write_all(b"old")).unwrap();
        let error =
            write_atomically(&path, |writer| writer.write_all(b"half").and(Err(disk_full())))
                .unwrap_err();
        assert!(
            error.to_string().starts_with(&format!("{}: cannot write: ", path.display())),
            "{error}"
        );
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(directory.path()), ["summary.json"]);
    }

    #[test]
    #[cfg(unix)]
    fn a_written_file_is_as_readable_as_any_other() {
        use std::os::unix::fs::PermissionsExt as _;
        let directory = tempfile::tempdir().unwrap();
        let (ours, plain) = (directory.path().join("ours"), directory.path().join("plain"));
        write_atomically(&ours, |_| Ok(())).unwrap();
        fs::write(&plain, "").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[test]
    fn a_directory_appears_whole_or_not_at_all() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("deep/run");
        let failed: Result<()> = write_directory_atomically(&path, |partial| {
            fs::write(partial.join("a"), "1").unwrap();
            Err(FileError::io("write", partial)(disk_full()))
        });
        assert!(failed.is_err());
        assert_eq!(names(path.parent().unwrap()), [""; 0]);
        let fill = |partial: &Path| write_json(&partial.join("a.json"), &1);
        write_directory_atomically(&path, fill).unwrap();
        assert_eq!(names(&path), ["a.json"]);
        assert_eq!(names(path.parent().unwrap()), ["run"]);
        let error = write_directory_atomically(&path, fill).unwrap_err();
        assert!(error.to_string().contains("is not empty"), "{error}");
    }

    #[test]
    fn what_a_killed_program_left_is_removed_and_nothing_else() {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir(root.path().join(".Ab3.partial")).unwrap();
        for name in [".Ab3.partial/a.json", ".x.partial", "a.partial", ".hidden"] {
            fs::write(root.path().join(name), "{").unwrap();
        }
        remove_partial(root.path()).unwrap();
        assert_eq!(names(root.path()), [".hidden", "a.partial"]);
    }

    #[test]
    fn an_empty_directory_may_be_filled_and_a_file_may_not() {
        let root = tempfile::tempdir().unwrap();
        let empty = root.path().join("empty");
        fs::create_dir(&empty).unwrap();
        create_output_directory(&empty).unwrap();
        write_directory_atomically(&empty, |partial| write_json(&partial.join("a.json"), &1))
            .unwrap();
        assert!(create_output_directory(&empty).is_err());
        assert!(create_output_directory(&empty.join("a.json")).is_err());
    }

    #[test]
    fn json_round_trips_bit_for_bit_compressed_and_not() {
        let directory = tempfile::tempdir().unwrap();
        let record =
            Record { version: 1, angles: vec![0.1, -core::f32::consts::PI, f32::MIN_POSITIVE] };
        for name in ["a.json", "a.json.gz"] {
            let path = directory.path().join(name);
            write_json(&path, &record).unwrap();
            assert_eq!(read_versioned_json::<Record>(&path, 1).unwrap(), record);
        }
        let compressed = fs::read(directory.path().join("a.json.gz")).unwrap();
        assert_eq!(compressed[..2], [0x1f, 0x8b]);
    }

    #[test]
    fn an_error_names_file_and_field() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.json");
        let message = |text: &str| {
            fs::write(&path, text).unwrap();
            let message = read_versioned_json::<Record>(&path, 1).unwrap_err().to_string();
            message.strip_prefix(&format!("{}: ", path.display())).unwrap().to_owned()
        };
        assert_eq!(
            message(r#"{"version": 2, "new": 0}"#),
            "version: 2 is unknown, this program reads version 1"
        );
        assert_eq!(message(r#"{"angles": []}"#), "version: is missing, expected 1");
        assert!(
            message(r#"{"version": 1, "angles": [0, "x"]}"#)
                .starts_with("angles[1]: invalid type: string")
        );
        assert!(message(r#"{"version": 1, "angels": []}"#).contains("unknown field `angels`"));
        assert!(message(r#"{"version": 1, "angles": []} x"#).starts_with("trailing characters"));
        assert!(message("").starts_with("EOF"));
    }

    #[test]
    fn reading_stops_at_the_limit_also_inside_a_compressed_file() {
        let directory = tempfile::tempdir().unwrap();
        for name in ["a.json", "a.json.gz"] {
            let path = directory.path().join(name);
            write_json(&path, &vec![0; 1000]).unwrap();
            assert!(read_bounded(&path, 3000).is_ok());
            assert!(read_bounded(&path, 1999).is_err());
        }
    }
}
