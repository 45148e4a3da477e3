//! What a description says of an arm: the first thing to run with a file that is new.

use super::super::arm::FileArm;
use super::super::failure::Result;
use core::fmt;
use lpr_core::glamx::Vec3;
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::{Described, Joint, JointMotion, Robot};
use lpr_core::scene::{Overlap, OverlapKind};
use serde::{Serialize, Serializer};
use std::collections::BTreeSet;

/// Configurations in which the tip is looked at.
const SAMPLES: u32 = 100_000;
/// Cubes that the tip gets into, along the radius of its reach: a number that does not grow with it.
const CUBES: i32 = 10;

#[derive(Debug, Serialize)]
pub(in crate::cli) struct Description {
    name: String,
    base: String,
    tip: String,
    joints: Vec<JointRow>,
    followers: Vec<FollowerRow>,
    tips: Vec<TipRow>,
    groups: Vec<GroupRow>,
    links: Vec<LinkRow>,
    pairs: Pairs,
    reach: Reach,
    warnings: Vec<String>,
}

#[derive(Debug, Serialize)]
struct JointRow {
    name: String,
    kind: &'static str,
    /// Radians or metres; null where it turns without end.
    limits: Option<[f32; 2]>,
    /// Radians or metres per second.
    max_velocity: f32,
}

#[derive(Debug, Serialize)]
struct FollowerRow {
    name: String,
    follows: String,
    multiplier: f64,
    offset: f64,
}

#[derive(Debug, Serialize)]
struct TipRow {
    link: String,
    joints: usize,
}

#[derive(Debug, Serialize)]
struct GroupRow {
    name: String,
    base: String,
    tip: String,
    joints: usize,
}

/// A link with geometry.
#[derive(Debug, Serialize)]
struct LinkRow {
    name: String,
    spheres: usize,
    /// Furthest that a sphere reaches beyond the geometry, metres.
    overshoot: f32,
    /// Tested by its geometry, to which the spheres do not matter.
    exact: bool,
}

/// Pairs of links with geometry.
#[derive(Debug, Serialize)]
struct Pairs {
    tested: usize,
    allowed: usize,
    /// Those that touch at rest or nearly always, or never but as spheres, all allowed; and those
    /// that are tested by their geometry where their spheres touch.
    touching: Vec<TouchingRow>,
}

#[derive(Debug, Serialize)]
struct TouchingRow {
    links: [String; 2],
    /// Share of the configurations in which their spheres touch.
    share: f32,
    /// `at rest`, `always`, `never` (but as spheres) or `close` (tested by their geometry).
    #[serde(serialize_with = "kind_name")]
    kind: OverlapKind,
}

#[derive(Debug, Serialize)]
struct Reach {
    /// Furthest that the tip was from the root, metres.
    radius: f32,
    /// Share of the ball of that radius that the tip gets into, by cubes of a tenth of it.
    share: f32,
}

pub(super) fn describe(arm: &FileArm) -> Result<Description> {
    let FileArm { described, overlaps } = arm;
    let Described { robot, warnings, tips, groups, base, tip } = described;
    let joint_row = |joint: &Joint| JointRow {
        name: joint.name.clone(),
        kind: match (joint.is_continuous, joint.motion) {
            (true, _) => "continuous",
            (false, JointMotion::Turn) => "revolute",
            (false, JointMotion::Slide) => "prismatic",
        },
        limits: (!joint.is_continuous).then_some([joint.lower, joint.upper]),
        max_velocity: joint.max_velocity,
    };
    let followers = robot.followers.iter().map(|follower| FollowerRow {
        name: follower.name.clone(),
        follows: robot.joints[follower.joint].name.clone(),
        multiplier: follower.multiplier,
        offset: follower.offset,
    });
    let solid = robot.links.iter().filter(|link| !link.spheres.is_empty());
    let n_solid = solid.clone().count();
    let allowed = robot.allowed_self_collisions.len();
    Ok(Description {
        name: robot.name.clone(),
        base: base.clone(),
        tip: tip.clone(),
        joints: robot.joints.iter().map(joint_row).collect(),
        followers: followers.collect(),
        tips: tips.iter().map(|(link, n)| TipRow { link: link.clone(), joints: *n }).collect(),
        groups: (groups.iter())
            .map(|group| GroupRow {
                name: group.name.clone(),
                base: group.base.clone(),
                tip: group.tip.clone(),
                joints: group.n_joints,
            })
            .collect(),
        links: solid
            .map(|link| LinkRow {
                name: link.name.clone(),
                spheres: link.spheres.len(),
                overshoot: link.overshoot,
                exact: link.is_exact,
            })
            .collect(),
        pairs: Pairs {
            tested: n_solid * n_solid.saturating_sub(1) / 2 - allowed,
            allowed,
            touching: overlaps.iter().map(|overlap| touching(robot, overlap)).collect(),
        },
        reach: reach(robot),
        warnings: warnings.clone(),
    })
}

fn touching(robot: &Robot, overlap: &Overlap) -> TouchingRow {
    let name = |link: usize| robot.links[link].name.clone();
    TouchingRow {
        links: [name(overlap.pair.0), name(overlap.pair.1)],
        share: overlap.share,
        kind: overlap.kind,
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn kind_name<S: Serializer>(kind: &OverlapKind, to: S) -> core::result::Result<S::Ok, S::Error> {
    to.serialize_str(match kind {
        OverlapKind::AtRest => "at rest",
        OverlapKind::NearlyAlways => "always",
        OverlapKind::Never => "never",
        OverlapKind::Close => "close",
    })
}

/// The tip in many configurations from a fixed seed.
fn reach(robot: &Robot) -> Reach {
    let rng = &mut stream(0, Stream::Ik, 0);
    let tip = |_| robot.grip(&robot.random_config(rng)).translation;
    let tips: Vec<Vec3> = (0..SAMPLES).map(tip).collect();
    let radius = tips.iter().fold(0.0_f32, |most, tip| most.max(tip.length()));
    let side = radius.max(f32::MIN_POSITIVE) / CUBES as f32;
    let cubes: BTreeSet<[i32; 3]> =
        tips.iter().map(|tip| (tip / side).floor().to_array().map(|cell| cell as i32)).collect();
    let is_within = |cell: [i32; 3]| {
        let center = Vec3::from_array(cell.map(|cell| cell as f32 + 0.5));
        center.length() <= CUBES as f32
    };
    let mut n_all = 0_u32;
    for x in -CUBES..CUBES {
        for y in -CUBES..CUBES {
            n_all += (-CUBES..CUBES).map(|z| u32::from(is_within([x, y, z]))).sum::<u32>();
        }
    }
    let n_reached = cubes.into_iter().filter(|cell| is_within(*cell)).count();
    Reach { radius, share: n_reached as f32 / n_all.max(1) as f32 }
}

impl fmt::Display for Description {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, base, tip, joints, reach, pairs, .. } = self;
        writeln!(f, "{name}: {} joints from {base} to {tip}", joints.len())?;
        writeln!(f, "\n{:<32}{:<12}{:>18}{:>12}", "joint", "kind", "limits", "velocity")?;
        for JointRow { name, kind, limits, max_velocity } in joints {
            let limits = limits
                .map_or_else(|| "none".to_owned(), |[low, high]| format!("{low:.3}..{high:.3}"));
            writeln!(f, "{name:<32}{kind:<12}{limits:>18}{max_velocity:>12.3}")?;
        }
        for FollowerRow { name, follows, multiplier, offset } in &self.followers {
            writeln!(f, "{name:<32}follows {follows}: {multiplier} q + {offset}")?;
        }
        writeln!(f, "\n{:<32}{:>8}{:>14}", "link with geometry", "spheres", "overshoot mm")?;
        for LinkRow { name, spheres, overshoot, exact } in &self.links {
            let overshoot =
                if *exact { "exact".to_owned() } else { format!("{:.1}", 1e3 * overshoot) };
            writeln!(f, "{name:<32}{spheres:>8}{overshoot:>14}")?;
        }
        writeln!(f, "\n{} pairs of links are tested, {} are not", pairs.tested, pairs.allowed)?;
        for TouchingRow { links: [a, b], share, kind } in &pairs.touching {
            let found = match kind {
                OverlapKind::AtRest => "they touch at rest",
                OverlapKind::NearlyAlways => "they touch nearly always",
                OverlapKind::Never => "they never touch",
                OverlapKind::Close => "tested by their geometry",
            };
            let percent = 100.0 * share;
            writeln!(f, "  {a} and {b}: {found}; as spheres in {percent:.1} % of configurations")?;
        }
        writeln!(
            f,
            "\ntips, with the joints above: {}",
            listed(self.tips.iter().map(|tip| { format!("{} ({})", tip.link, tip.joints) }))
        )?;
        if !self.groups.is_empty() {
            writeln!(
                f,
                "groups that are chains: {}",
                listed(self.groups.iter().map(|group| {
                    format!("{} ({} to {}, {})", group.name, group.base, group.tip, group.joints)
                }))
            )?;
        }
        writeln!(
            f,
            "the tip reaches {:.2} m, and {:.0} % of the ball of that radius",
            reach.radius,
            100.0 * reach.share
        )?;
        self.warnings.iter().try_for_each(|warning| writeln!(f, "warning: {warning}"))
    }
}

fn listed(words: impl Iterator<Item = String>) -> String {
    words.collect::<Vec<_>>().join(", ")
}
