//! The view of an agent's camera, one channel as a picture.

use clap::ValueEnum;
use core::fmt;
use lpr_core::sim::render::{Channel, NO_ITEM, value_color};
use lpr_core::sim::{CameraRequest, MaskLabel, SimEnvironment};
use serde::Serialize;
use std::collections::BTreeMap;

/// Colour of pixels that see nothing, and of holes in a depth image.
const NOTHING_RGB: [u8; 3] = [0; 3];

/// A channel of an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Show {
    /// Colour
    Rgb,
    /// Depth: near is bright, far is dark, nothing is black
    Depth,
    /// Which body or link each pixel sees
    Mask,
}

/// Numbers that a person cannot read off the picture.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(super) enum Legend {
    /// Of a depth image.
    Depth {
        /// Nearest and farthest depth seen, metres.
        depth: [f32; 2],
        /// Share of the pixels with a depth.
        share: f32,
    },
    /// Of a mask.
    Mask { mask: Vec<MaskRow> },
}

/// A body or link that a mask shows.
#[derive(Debug, Serialize)]
pub(super) struct MaskRow {
    value: u16,
    name: String,
    rgb: [u8; 3],
    pixels: usize,
}

impl fmt::Display for Legend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Depth { depth: [near, far], share } => {
                write!(f, ", {near:.3} to {far:.3} m, {:.1} % seen", 100.0 * share)
            }
            Self::Mask { mask } => {
                mask.iter().try_for_each(|MaskRow { value, name, rgb: [r, g, b], pixels }| {
                    write!(f, "\n  {value:>3} #{r:02x}{g:02x}{b:02x} {pixels:>7} pixels  {name}")
                })
            }
        }
    }
}

/// The picture of one channel of a built-in camera.
pub(super) fn draw(
    environment: &mut SimEnvironment,
    show: Show,
    camera: &str,
    size: [usize; 2],
) -> lpr_core::Result<(Vec<[u8; 3]>, Option<Legend>)> {
    let channel = match show {
        Show::Rgb => Channel::Rgb,
        Show::Depth => Channel::Depth,
        Show::Mask => Channel::Mask,
    };
    let request = CameraRequest { camera: camera.to_owned(), size, channels: vec![channel] };
    let capture = environment.frames(&[request])?.remove(0);
    Ok(match (capture.rgb, capture.depth, capture.mask) {
        (Some(rgb), ..) => (rgb, None),
        (_, Some(depth), _) => depth_picture(&depth),
        (.., mask) => mask_picture(environment, &mask.unwrap_or_default()),
    })
}

fn depth_picture(depth: &[f32]) -> (Vec<[u8; 3]>, Option<Legend>) {
    let seen = || depth.iter().copied().filter(|depth| depth.is_finite());
    let (near, far) = seen()
        .fold((f32::INFINITY, 0.0_f32), |(near, far), depth| (near.min(depth), far.max(depth)));
    let color = |depth: &f32| {
        if depth.is_finite() { value_color((far - depth) / (far - near)) } else { NOTHING_RGB }
    };
    let share = seen().count() as f32 / depth.len() as f32;
    let legend = (share > 0.0).then_some(Legend::Depth { depth: [near, far], share });
    (depth.iter().map(color).collect(), legend)
}

fn mask_picture(environment: &SimEnvironment, mask: &[u16]) -> (Vec<[u8; 3]>, Option<Legend>) {
    let mut pixels: BTreeMap<u16, usize> = BTreeMap::new();
    mask.iter()
        .filter(|value| **value != NO_ITEM)
        .for_each(|value| *pixels.entry(*value).or_default() += 1);
    let name = |value: u16| match MaskLabel::of(environment.world(), value) {
        Some(MaskLabel::Body { name, .. }) => name.to_owned(),
        Some(MaskLabel::Robot { part }) => part.to_owned(),
        Some(MaskLabel::Nothing) | None => "nothing".to_owned(),
    };
    let row =
        |(value, pixels)| MaskRow { value, name: name(value), rgb: mask_color(value), pixels };
    let legend = Legend::Mask { mask: pixels.into_iter().map(row).collect() };
    (mask.iter().map(|&value| mask_color(value)).collect(), Some(legend))
}

/// A colour for each value; neighbours differ much.
fn mask_color(value: u16) -> [u8; 3] {
    /// Part of the circle of hues from one value to the next: the golden section comes never near
    /// where it was.
    const TURN: f32 = 0.618_034;
    if value == NO_ITEM {
        return NOTHING_RGB;
    }
    let hue = f32::from(value) * TURN;
    let strength = if value.is_multiple_of(2) { 235.0 } else { 170.0 };
    [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|offset| {
        let along = (hue + offset).fract();
        let level = (6.0 * (along - 0.5).abs() - 1.0).clamp(0.0, 1.0);
        (strength * (0.15 + 0.85 * level)) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_a_mask_look_different() {
        let colors: Vec<_> = (0..40).map(mask_color).collect();
        for (idx, color) in colors.iter().enumerate() {
            let distance = |other: &[u8; 3]| {
                color.iter().zip(other).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>()
            };
            assert!(colors[..idx].iter().all(|other| distance(other) > 8), "{idx}: {color:?}");
        }
    }

    #[test]
    fn near_is_bright_and_holes_are_black() {
        let (picture, legend) = depth_picture(&[0.5, 2.0, f32::INFINITY, 1.25]);
        assert_eq!(picture, [value_color(1.0), value_color(0.0), NOTHING_RGB, value_color(0.5)]);
        assert!(matches!(legend, Some(Legend::Depth { depth: [0.5, 2.0], share: 0.75 })));
        assert!(depth_picture(&[f32::INFINITY; 3]).1.is_none());
    }
}
