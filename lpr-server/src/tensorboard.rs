//! Scalars as TensorBoard reads them: `TFRecord` framing around hand-encoded `tensorflow.Event`
//! messages.
//!
//! The one crate for this brings a protobuf runtime and an image library along; scalars need five
//! fields. Formats: `tensorflow/core/util/event.proto`, `tensorflow/core/lib/io/record_writer.h`.

use crate::files::{self, FileError, Result};
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Name of the file in a run directory: TensorBoard looks for `tfevents` in it.
pub const FILE_NAME: &str = "events.out.tfevents.lpr";

/// Appends scalars to an event file.
#[derive(Debug)]
pub struct EventWriter {
    file: File,
    path: PathBuf,
}

impl EventWriter {
    /// Creates the event file of a new run in `run_directory`.
    ///
    /// # Errors
    ///
    /// When it exists or cannot be written.
    pub fn create(run_directory: &Path, wall_seconds: f64) -> Result<Self> {
        let path = run_directory.join(FILE_NAME);
        let file = File::create_new(&path).map_err(FileError::io("create", &path))?;
        let mut writer = Self { file, path };
        writer.append(&version_event(wall_seconds))?;
        Ok(writer)
    }

    /// Goes on with the event file in `run_directory` after dropping what is later than `last_step`
    /// or torn.
    ///
    /// # Errors
    ///
    /// When it is missing or cannot be rewritten.
    pub fn resume(run_directory: &Path, last_step: u64) -> Result<Self> {
        let path = run_directory.join(FILE_NAME);
        let old = std::fs::read(&path).map_err(FileError::io("read", &path))?;
        files::write_atomically(&path, |writer| {
            records(&old)
                .filter(|event| step_of(event) <= last_step)
                .try_for_each(|event| writer.write_all(&framed(event)))
        })?;
        let file =
            OpenOptions::new().append(true).open(&path).map_err(FileError::io("write", &path))?;
        Ok(Self { file, path })
    }

    /// Writes one value per tag for `step`, taken at `wall_seconds` since 1970.
    ///
    /// # Errors
    ///
    /// When the file cannot be written.
    pub fn write_scalars(
        &mut self,
        step: u64,
        wall_seconds: f64,
        scalars: &[(&str, f32)],
    ) -> Result<()> {
        self.append(&scalar_event(step, wall_seconds, scalars))
    }

    fn append(&mut self, event: &[u8]) -> Result<()> {
        self.file.write_all(&framed(event)).map_err(FileError::io("write", &self.path))
    }
}

// Field numbers of tensorflow.Event, .Summary and .Summary.Value.
const EVENT_WALL_TIME: u32 = 1;
const EVENT_STEP: u32 = 2;
const EVENT_FILE_VERSION: u32 = 3;
const EVENT_SUMMARY: u32 = 5;
const SUMMARY_VALUE: u32 = 1;
const VALUE_TAG: u32 = 1;
const VALUE_SIMPLE_VALUE: u32 = 2;

// Wire types of protobuf.
const VARINT: u32 = 0;
const FIXED64: u32 = 1;
const BYTES: u32 = 2;
const FIXED32: u32 = 5;

/// The message that must come first in a file.
fn version_event(wall_seconds: f64) -> Vec<u8> {
    let mut event = Vec::new();
    put_fixed64(&mut event, EVENT_WALL_TIME, wall_seconds);
    put_bytes(&mut event, EVENT_FILE_VERSION, b"brain.Event:2");
    event
}

fn scalar_event(step: u64, wall_seconds: f64, scalars: &[(&str, f32)]) -> Vec<u8> {
    let mut summary = Vec::new();
    for (tag, scalar) in scalars {
        let mut value = Vec::new();
        put_bytes(&mut value, VALUE_TAG, tag.as_bytes());
        put_varint(&mut value, u64::from(VALUE_SIMPLE_VALUE << 3 | FIXED32));
        value.extend(scalar.to_le_bytes());
        put_bytes(&mut summary, SUMMARY_VALUE, &value);
    }
    let mut event = Vec::new();
    put_fixed64(&mut event, EVENT_WALL_TIME, wall_seconds);
    put_varint(&mut event, u64::from(EVENT_STEP << 3 | VARINT));
    put_varint(&mut event, step);
    put_bytes(&mut event, EVENT_SUMMARY, &summary);
    event
}

fn put_fixed64(message: &mut Vec<u8>, field: u32, value: f64) {
    put_varint(message, u64::from(field << 3 | FIXED64));
    message.extend(value.to_le_bytes());
}

fn put_bytes(message: &mut Vec<u8>, field: u32, bytes: &[u8]) {
    put_varint(message, u64::from(field << 3 | BYTES));
    put_varint(message, bytes.len() as u64);
    message.extend(bytes);
}

fn put_varint(message: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        message.push(value as u8 | 0x80);
        value >>= 7;
    }
    message.push(value as u8);
}

/// The step of an event that this file wrote: right after the wall time, absent (0) in the version
/// event.
fn step_of(event: &[u8]) -> u64 {
    const WALL_TIME_BYTES: usize = 1 + 8;
    let Some((&tag, varint)) = event.get(WALL_TIME_BYTES..).and_then(<[u8]>::split_first) else {
        return 0;
    };
    if u32::from(tag) != EVENT_STEP << 3 | VARINT {
        return 0;
    }
    let last = varint.iter().take(9).position(|byte| byte & 0x80 == 0).unwrap_or(9);
    varint.iter().take(last + 1).rev().fold(0, |step, byte| step << 7 | u64::from(byte & 0x7f))
}

/// One `TFRecord`: length, its checksum, content, its checksum.
fn framed(content: &[u8]) -> Vec<u8> {
    let length = (content.len() as u64).to_le_bytes();
    let parts: [&[u8]; 4] = [&length, &masked_crc32c(&length), content, &masked_crc32c(content)];
    parts.concat()
}

/// The contents of all records up to the first that is torn or corrupt.
fn records(mut file: &[u8]) -> impl Iterator<Item = &[u8]> {
    core::iter::from_fn(move || {
        let (length, rest) = file.split_first_chunk::<8>()?;
        let (length_crc, rest) = rest.split_first_chunk::<4>()?;
        let (content, rest) =
            rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        let (content_crc, rest) = rest.split_first_chunk::<4>()?;
        file = rest;
        (masked_crc32c(length) == *length_crc && masked_crc32c(content) == *content_crc)
            .then_some(content)
    })
}

/// The checksum of a record, rotated and offset since CRCs of data that holds CRCs are weak.
fn masked_crc32c(bytes: &[u8]) -> [u8; 4] {
    const MASK_DELTA: u32 = 0xa282_ead8;
    crc32c(bytes).rotate_right(15).wrapping_add(MASK_DELTA).to_le_bytes()
}

fn crc32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, &byte| crc >> 8 ^ CRC32C_TABLE[(crc as u8 ^ byte) as usize])
}

/// Of the Castagnoli polynomial, bits reversed.
static CRC32C_TABLE: [u32; 256] = {
    let mut table = [0; 256];
    let mut idx = 0;
    while idx < table.len() {
        let mut crc = idx as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = crc >> 1 ^ if crc & 1 == 1 { 0x82f6_3b78 } else { 0 };
            bit += 1;
        }
        table[idx] = crc;
        idx += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crc32c_of_rfc_3720() {
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        let ascending: Vec<u8> = (0..32).collect();
        assert_eq!(crc32c(&ascending), 0x46dd_794e);
    }

    // Written by RecordWriter of the PyPI package tensorboard 2.21.0.
    const VERSION_RECORD: &[u8] =
        b"\x18\x00\x00\x00\x00\x00\x00\x00\xa3\x7fK\x22\x09\x00\x00\x00\x00\x00\x00\xf0?\x1a\x0dbrain.Event:2\x86\xbfWz";
    const SCALAR_RECORD: &[u8] = b"$\x00\x00\x00\x00\x00\x00\x00B+\x80M\x09\x00\x00\x00\x00\x00\x00\xf0?\x10\xac\x02*\x16\x0a\x14\x0a\x0dlosses/ranker\x15\x00\x00\x80>rgB,";

    #[test]
    fn records_are_those_that_tensorboard_writes() {
        assert_eq!(framed(&version_event(1.0)), VERSION_RECORD);
        assert_eq!(framed(&scalar_event(300, 1.0, &[("losses/ranker", 0.25)])), SCALAR_RECORD);
    }

    #[test]
    fn resuming_drops_later_steps_and_a_torn_record() {
        let run = tempfile::tempdir().unwrap();
        let mut writer = EventWriter::create(run.path(), 0.0).unwrap();
        for step in [1, 200, 40_000, u64::MAX] {
            writer.write_scalars(step, 0.5, &[("a", 1.0), ("b", -2.0)]).unwrap();
        }
        writer.file.write_all(&framed(b"torn")[..9]).unwrap();
        assert!(EventWriter::create(run.path(), 0.0).is_err());

        let mut writer = EventWriter::resume(run.path(), 200).unwrap();
        writer.write_scalars(201, 1.5, &[("a", 3.0)]).unwrap();
        let file = std::fs::read(run.path().join(FILE_NAME)).unwrap();
        let steps: Vec<_> = records(&file).map(step_of).collect();
        assert_eq!(steps, [0, 1, 200, 201]);
    }

    #[test]
    fn steps_of_every_length_are_read_back() {
        for step in (0..64).map(|bit| 1_u64 << bit).chain([0, 127, u64::MAX]) {
            assert_eq!(step_of(&scalar_event(step, 0.0, &[])), step);
        }
    }
}
