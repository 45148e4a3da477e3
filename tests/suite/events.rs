//! TensorBoard's event file, read by a decoder that shares nothing with the writer.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::runs::{self, LEARNED, ORACLE, Runs};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// One value of one tag at one step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Scalar {
    step: u64,
    tag: String,
    value: f32,
}

/// One `tensorflow.Event`.
#[derive(Debug, Default)]
struct Event {
    wall_time: f64,
    step: u64,
    file_version: String,
    values: Vec<(String, f32)>,
}

/// The value of a protobuf field.
enum Field<'a> {
    Varint(u64),
    Fixed64([u8; 8]),
    Bytes(&'a [u8]),
    Fixed32([u8; 4]),
}

/// All scalars of a run in the order of the file.
pub(crate) fn scalars(run: &Path) -> Vec<Scalar> {
    let scalar = |step: u64| move |(tag, value)| Scalar { step, tag, value };
    events(run)
        .into_iter()
        .flat_map(|event| event.values.into_iter().map(scalar(event.step)))
        .collect()
}

fn events(run: &Path) -> Vec<Event> {
    let is_event_file =
        |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().contains("tfevents");
    let mut files: Vec<_> = fs::read_dir(run)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(is_event_file)
        .collect();
    assert_eq!(files.len(), 1, "{files:?}");
    let bytes = fs::read(files.remove(0)).unwrap();
    records(&bytes).into_iter().map(event).collect()
}

/// The contents of the `TFRecord`s that fill a file.
fn records(mut bytes: &[u8]) -> Vec<&[u8]> {
    let mut records = Vec::new();
    while !bytes.is_empty() {
        let (length, rest) = bytes.split_at(8);
        let (length_crc, rest) = rest.split_at(4);
        assert_eq!(u32::from_le_bytes(length_crc.try_into().unwrap()), masked_crc32c(length));
        let (content, rest) =
            rest.split_at(u64::from_le_bytes(length.try_into().unwrap()) as usize);
        let (content_crc, rest) = rest.split_at(4);
        assert_eq!(u32::from_le_bytes(content_crc.try_into().unwrap()), masked_crc32c(content));
        records.push(content);
        bytes = rest;
    }
    records
}

/// Bit by bit, as RFC 3720 defines it, with the mask of `tensorflow/core/lib/hash/crc32c.h`.
fn masked_crc32c(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc % 2 == 1 { (crc / 2) ^ 0x82f6_3b78 } else { crc / 2 };
        }
    }
    (!crc).rotate_right(15).wrapping_add(0xa282_ead8)
}

fn event(message: &[u8]) -> Event {
    let mut event = Event::default();
    for field in fields(message) {
        match field {
            (1, Field::Fixed64(bytes)) => event.wall_time = f64::from_le_bytes(bytes),
            (2, Field::Varint(step)) => event.step = step,
            (3, Field::Bytes(version)) => {
                event.file_version = String::from_utf8(version.to_vec()).unwrap();
            }
            (5, Field::Bytes(summary)) => {
                event.values = fields(summary).iter().map(summary_value).collect();
            }
            (number, _) => panic!("an event has no field {number} of this type"),
        }
    }
    event
}

fn summary_value(field: &(u64, Field<'_>)) -> (String, f32) {
    let (1, Field::Bytes(message)) = field else { panic!("a summary holds values only") };
    let (mut tag, mut scalar) = (None, None);
    for field in fields(message) {
        match field {
            (1, Field::Bytes(bytes)) => tag = Some(String::from_utf8(bytes.to_vec()).unwrap()),
            (2, Field::Fixed32(bytes)) => scalar = Some(f32::from_le_bytes(bytes)),
            (number, _) => panic!("a scalar has no field {number} of this type"),
        }
    }
    (tag.unwrap(), scalar.unwrap())
}

/// Numbers and values of the fields of a message.
fn fields(mut message: &[u8]) -> Vec<(u64, Field<'_>)> {
    let mut fields = Vec::new();
    while !message.is_empty() {
        let key = varint(&mut message);
        let field = match key & 7 {
            0 => Field::Varint(varint(&mut message)),
            1 => Field::Fixed64(taken(&mut message, 8).try_into().unwrap()),
            2 => {
                let length = varint(&mut message) as usize;
                Field::Bytes(taken(&mut message, length))
            }
            5 => Field::Fixed32(taken(&mut message, 4).try_into().unwrap()),
            other => panic!("wire type {other}"),
        };
        fields.push((key >> 3, field));
    }
    fields
}

fn varint(message: &mut &[u8]) -> u64 {
    let mut value = 0;
    for place in 0.. {
        let byte = taken(message, 1)[0];
        value |= u64::from(byte & 0x7f) << (7 * place);
        if byte < 0x80 {
            break;
        }
    }
    value
}

fn taken<'a>(message: &mut &'a [u8], n: usize) -> &'a [u8] {
    let (taken, rest) = message.split_at(n);
    *message = rest;
    taken
}

/// Every scalar of the event file is in `metrics.jsonl` and the other way round.
fn assert_events_are_the_metrics(run: &Path) {
    let events = events(run);
    assert_eq!((events[0].file_version.as_str(), events[0].values.len()), ("brain.Event:2", 0));
    assert!(events.windows(2).all(|pair| pair[0].wall_time <= pair[1].wall_time));
    assert!(events[0].wall_time > 1.6e9, "seconds since 1970");
    let points = runs::metrics(run);
    assert_eq!(events.len(), points.len() + 1);
    for (event, point) in events[1..].iter().zip(points) {
        assert_eq!(point["env_steps"], event.step);
        let values = point
            .iter()
            .filter(|(key, _)| !["env_steps", "updates", "wall_seconds"].contains(&key.as_str()));
        let expected: BTreeMap<_, _> =
            values.map(|(key, value)| (key.clone(), value.as_f64().unwrap() as f32)).collect();
        assert!(expected.len() >= 3, "{point:?}");
        assert_eq!(event.values.iter().cloned().collect::<BTreeMap<_, _>>(), expected);
        assert_eq!(event.values.len(), expected.len(), "a tag stands twice in {event:?}");
    }
}

#[test]
fn the_checksum_is_that_of_rfc_3720() {
    // The unmasked checksum of 32 zeros is 8a9136aa.
    assert_eq!(
        masked_crc32c(&[0; 32]),
        (0x8a91_36aa_u32.rotate_right(15)).wrapping_add(0xa282_ead8)
    );
}

#[test]
fn every_scalar_of_the_event_file_is_in_the_metrics() {
    let runs = Runs::new();
    for (kind, tags) in [
        (ORACLE, ["losses/ranker", "episode/success"]),
        (LEARNED, ["losses/q_attention", "value/pose"]),
    ] {
        let run = runs.train(kind, kind.task);
        assert_events_are_the_metrics(&run);
        let scalars = scalars(&run);
        for tag in tags.into_iter().chain(["validation/success_rate", "reward"]) {
            assert!(scalars.iter().any(|scalar| scalar.tag == tag), "no {tag}");
        }
    }
}
