//! Pairs of links that overlap however the arm stands, as covers and sensors do, or that never
//! meet, though their spheres, which reach beyond them, do. As the set-up assistants of planners
//! decide, they are no obstacle. Others pass each other so closely that their spheres are not enough
//! to tell; they are tested by their geometry.

use super::arm_spheres::ArmSpheres;
use super::geometry::Geometries;
use super::proximity::Placed;
use crate::error::Result;
use crate::rng::{Stream, stream};
use crate::robot::{JointConfig, Robot};

/// Configurations that are drawn.
const SAMPLES: u32 = 10_000;
/// Of them, those after which only pairs are counted that may be told of.
const FIRST: u32 = 300;
/// Of the first of them, the share in contact from which on a pair may be one that nearly always is.
const OFTEN: f32 = 0.67;
/// Configurations in which spheres touched and the geometry did not, from which on a pair counts as
/// one that never meets. A pair that meets in one of a hundred of them is seen to with a probability
/// of 95 %.
const APART: u32 = 300;
/// Configurations in which spheres touch that are looked at of a pair that meets.
const LOOKS: u32 = 30;
/// Of the first configurations, those that are looked at of every pair.
const FIRST_LOOKS: u32 = 10;
/// Share of the configurations in contact from which on a pair counts as one that always is.
const NEARLY_ALWAYS: f32 = 0.95;
/// Share of the configurations in which spheres touch and the geometry does not from which on a pair
/// is tested by its geometry.
const CLOSE: f32 = 0.05;
/// The same of the first configurations, by a few looks.
const MAYBE_CLOSE: f32 = 0.02;

/// A pair of links that overlaps at rest or nearly always, or often as spheres alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overlap {
    /// Indices into [`Robot::links`], `a < b`.
    pub pair: (usize, usize),
    /// Share of the drawn configurations in which their spheres touch; 0 to 1.
    pub share: f32,
    /// Why they are no obstacle, or how they are tested.
    pub kind: OverlapKind,
}

/// What is to be done about a pair of links whose spheres touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapKind {
    /// No obstacle: they touch with every joint at 0, moved into its limits.
    AtRest,
    /// No obstacle: they touch in at least 95 % of the configurations.
    NearlyAlways,
    /// No obstacle: their geometry was apart in the first 300 configurations in which their spheres
    /// touched.
    Never,
    /// Tested by their geometry where their spheres touch: these do at rest, or in 5 % of the
    /// configurations, where it does not.
    Close,
}

/// A pair of links, counted.
struct Counted {
    links: (usize, usize),
    /// True if the spheres touch at rest.
    at_rest: bool,
    /// Configurations in which the spheres touched.
    n_contacts: u32,
    /// Those of them that were looked at, and in which the geometry touched.
    n_looks: u32,
    n_meets: u32,
}

/// The pairs of links that touch at rest, or in at least 95 % of 10,000 configurations from a fixed
/// seed, and are not allowed to; those whose geometry, boxes and meshes, was apart in 300
/// configurations in which their spheres touched; and those whose spheres touch at rest, or in 5 % of
/// the configurations, where their geometry does not. Of a description that is used as it was found.
/// Without the feature `hulls` spheres stand for the geometry.
///
/// ```
/// use lpr_core::robot::{Robot, JointConfig};
/// use lpr_core::scene::{ArmSpheres, OverlapKind, Scene, overlaps};
///
/// // A cover around the first joint that reaches to the third link.
/// let link = |name: &str, at: f32, radius: f32| {
///     format!(r#"<link name="{name}"><collision><origin xyz="0 0 {at}"/><geometry><sphere radius="{radius}"/></geometry></collision></link>"#)
/// };
/// let joint = |name: &str, parent: &str, child: &str| {
///     format!(
///         r#"<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 0.1"/>
///         <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1"/></joint>"#
///     )
/// };
/// let urdf = format!(
///     r#"<robot name="r">{}{}{}{}{}</robot>"#,
///     link("cover", 0.1, 0.095), link("elbow", 0.0, 0.01), link("hand", 0.0, 0.01),
///     joint("a", "cover", "elbow"), joint("b", "elbow", "hand"),
/// );
/// let mut arm = Robot::from_urdf(&urdf, None, None, &|_| None)?;
/// let found = overlaps(&arm)?;
/// assert_eq!((found.len(), found[0].pair, found[0].kind), (1, (0, 2), OverlapKind::AtRest));
/// arm.allow(&found);
/// assert!(Scene::empty().is_free(&ArmSpheres::from_description(&arm)?, &arm.start));
/// # Ok::<(), lpr_core::Error>(())
/// ```
///
/// # Errors
///
/// As [`ArmSpheres::from_description`].
pub fn overlaps(robot: &Robot) -> Result<Vec<Overlap>> {
    let arm = ArmSpheres::from_description(robot)?;
    let rest = JointConfig::from_fn(robot.dof(), |j| {
        0.0_f32.max(robot.joints[j].lower).min(robot.joints[j].upper)
    });
    let rest = Placed::new(&arm, &rest);
    let geometries = Geometries::of(robot);
    let counted = |links: (usize, usize)| {
        let at_rest = rest.touch(links.0, links.1);
        Counted { links, at_rest, n_contacts: 0, n_looks: 0, n_meets: 0 }
    };
    let mut pairs: Vec<Counted> = arm.tested_pairs().into_iter().map(counted).collect();
    let rng = &mut stream(0, Stream::SelfPairs, 0);
    for sample in 1..=SAMPLES {
        let placed = Placed::new(&arm, &robot.random_config(rng));
        for pair in &mut pairs {
            if placed.touch(pair.links.0, pair.links.1) {
                pair.n_contacts += 1;
                if pair.n_looks < pair.looks(sample) {
                    pair.n_looks += 1;
                    pair.n_meets += u32::from(touch(&geometries, &placed, pair.links));
                }
            }
        }
        if sample == FIRST {
            pairs.retain(Counted::may_be_told_of);
        }
    }
    let overlap = |pair: &Counted| {
        let (a, b) = (arm.link(pair.links.0).index(), arm.link(pair.links.1).index());
        let share = pair.n_contacts as f32 / SAMPLES as f32;
        let touch_at_rest = pair.at_rest && touch(&geometries, &rest, pair.links);
        let kind = pair.kind(share, touch_at_rest)?;
        Some(Overlap { pair: (a.min(b), a.max(b)), share, kind })
    };
    let mut found: Vec<Overlap> = pairs.iter().filter_map(overlap).collect();
    found.sort_by_key(|overlap| overlap.pair);
    Ok(found)
}

impl Counted {
    /// Configurations with contact that are to be looked at, up to this sample.
    const fn looks(&self, sample: u32) -> u32 {
        match (self.n_meets, sample) {
            (0, _) => APART,
            (_, ..=FIRST) => FIRST_LOOKS,
            _ => LOOKS,
        }
    }

    /// Share of the contacts looked at in which the geometry touched.
    fn meets(&self) -> f32 {
        self.n_meets as f32 / self.n_looks.max(1) as f32
    }

    /// After the first samples: false of a pair of which nothing is to be told.
    fn may_be_told_of(&self) -> bool {
        let share = self.n_contacts as f32 / FIRST as f32;
        self.at_rest
            || self.n_meets == 0
            || share > OFTEN
            || share * (1.0 - self.meets()) > MAYBE_CLOSE
    }

    fn kind(&self, share: f32, touch_at_rest: bool) -> Option<OverlapKind> {
        if touch_at_rest {
            Some(OverlapKind::AtRest)
        } else if share * self.meets() >= NEARLY_ALWAYS {
            Some(OverlapKind::NearlyAlways)
        } else if self.n_meets == 0 && self.n_looks == APART {
            Some(OverlapKind::Never)
        } else {
            let is_close = self.at_rest || share * (1.0 - self.meets()) >= CLOSE;
            is_close.then_some(OverlapKind::Close)
        }
    }
}

/// True if the geometry of two links touches; also where it is not known of one of them.
fn touch(geometries: &Geometries<'_>, placed: &Placed<'_>, (a, b): (usize, usize)) -> bool {
    let [(a, world_from_a), (b, world_from_b)] = [placed.body(a), placed.body(b)];
    geometries.pair(a, b).is_none_or(|(a, b)| a.touches(world_from_a, b, world_from_b))
}

impl Robot {
    /// Allows those pairs to touch, or has them tested by their geometry.
    pub fn allow(&mut self, overlaps: &[Overlap]) {
        for overlap in overlaps {
            let pairs = match overlap.kind {
                OverlapKind::Close => &mut self.close_pairs,
                _ => &mut self.allowed_self_collisions,
            };
            pairs.push(overlap.pair);
        }
        for pairs in [&mut self.close_pairs, &mut self.allowed_self_collisions] {
            pairs.sort_unstable();
            pairs.dedup();
        }
    }
}
