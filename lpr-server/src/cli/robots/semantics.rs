//! An SRDF with the arm as a group, and the pairs of links that are never tested.

use super::super::arm::FileArm;
use super::super::failure::Result;
use crate::files;
use lpr_core::scene::OverlapKind;
use std::fmt::Write as _;
use std::path::Path;

/// Writes it, whole or not at all.
pub(super) fn write(path: &Path, arm: &FileArm) -> Result<()> {
    let text = text(arm);
    Ok(files::write_atomically(path, |writer| writer.write_all(text.as_bytes()))?)
}

fn text(FileArm { described, overlaps }: &FileArm) -> String {
    let robot = &described.robot;
    let name = |link: usize| escaped(&robot.links[link].name);
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n  <group name=\"arm\">\n    \
         <chain base_link=\"{}\" tip_link=\"{}\"/>\n  </group>\n",
        escaped(&robot.name),
        escaped(&described.base),
        escaped(&described.tip)
    );
    for &(a, b) in &robot.allowed_self_collisions {
        let found = overlaps.iter().find(|overlap| overlap.pair == (a, b));
        // The words of the set-up assistant of MoveIt.
        let is_adjacent = robot.links[a].body.abs_diff(robot.links[b].body) <= 1;
        let reason = match found.map(|overlap| overlap.kind) {
            Some(OverlapKind::AtRest) => "Default",
            Some(OverlapKind::NearlyAlways) => "Always",
            Some(OverlapKind::Never) => "Never",
            None if is_adjacent => "Adjacent",
            // As the SRDF says that was given.
            None | Some(OverlapKind::Close) => "User",
        };
        let (a, b) = (name(a), name(b));
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "  <disable_collisions link1=\"{a}\" link2=\"{b}\" reason=\"{reason}\"/>"
        );
    }
    text.push_str("</robot>\n");
    text
}

fn escaped(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
