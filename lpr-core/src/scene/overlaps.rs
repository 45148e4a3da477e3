//! Pairs of links that overlap however the arm stands, as covers and sensors do, or that never
//! meet, though their spheres, which reach beyond them, do. As the set-up assistants of planners
//! decide, they are no obstacle.

use super::arm_spheres::ArmSpheres;
#[cfg(feature = "hulls")]
use super::geometry::Geometry;
use super::proximity::Placed;
use crate::error::Result;
use crate::rng::{Stream, stream};
use crate::robot::{JointConfig, Robot};
#[cfg(not(feature = "hulls"))]
use glamx::Pose3;

/// Configurations that are drawn.
const SAMPLES: u32 = 10_000;
/// Of them, those after which a pair that was apart in more than a third is one that moves apart.
const FIRST: u32 = 300;
/// Configurations in which spheres touched and the geometry did not, from which on a pair counts as
/// one that never meets. A pair that meets in one of a hundred of them is seen to with a probability
/// of 95 %.
const APART: u32 = 300;
/// Share of the configurations in contact from which on a pair counts as one that always is.
const NEARLY_ALWAYS: f32 = 0.95;

/// A pair of links that overlaps at rest or nearly always, or never but as spheres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overlap {
    /// Indices into [`Robot::links`], `a < b`.
    pub pair: (usize, usize),
    /// Share of the drawn configurations in which they touch; 0 to 1.
    pub share: f32,
    /// True if they touch with every joint at 0, moved into its limits.
    pub at_rest: bool,
    /// True if their geometry was apart in the first 300 of these configurations.
    pub never: bool,
}

/// A pair of links, counted.
struct Counted {
    links: (usize, usize),
    at_rest: bool,
    /// Configurations in which the spheres touched.
    n_contacts: u32,
    /// True if the geometry touched in one of those looked at.
    meets: bool,
}

/// The pairs of links that touch at rest, or in at least 95 % of 10,000 configurations from a fixed
/// seed, and are not allowed to; and those whose geometry, boxes and meshes, was apart in 300
/// configurations in which their spheres touched (with the feature `hulls` alone): of a description
/// that is used as it was found.
///
/// ```
/// use lpr_core::robot::{Robot, JointConfig};
/// use lpr_core::scene::{ArmSpheres, Scene, overlaps};
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
/// assert_eq!((found.len(), found[0].pair, found[0].at_rest), (1, (0, 2), true));
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
    let geometry = Geometry::new(robot);
    let counted = |(a, b)| {
        let at_rest = rest.touch(a, b);
        Counted { links: (a, b), at_rest, n_contacts: 0, meets: false }
    };
    let mut pairs: Vec<Counted> = arm.tested_pairs().into_iter().map(counted).collect();
    let rng = &mut stream(0, Stream::SelfPairs, 0);
    for sample in 1..=SAMPLES {
        let placed = Placed::new(&arm, &robot.random_config(rng));
        for pair in &mut pairs {
            let (a, b) = pair.links;
            if !placed.touch(a, b) {
                continue;
            }
            pair.n_contacts += 1;
            if !pair.meets && pair.n_contacts <= APART {
                pair.meets = geometry.touch(placed.body(a), placed.body(b));
            }
        }
        if sample == FIRST {
            pairs.retain(|pair| pair.at_rest || !pair.meets || 3 * pair.n_contacts > 2 * FIRST);
        }
    }
    let mut found: Vec<Overlap> = (pairs.into_iter())
        .map(|Counted { links: (a, b), at_rest, n_contacts, meets }| {
            let (a, b) = (arm.link(a).index(), arm.link(b).index());
            let share = n_contacts as f32 / SAMPLES as f32;
            let never = !meets && n_contacts >= APART;
            Overlap { pair: (a.min(b), a.max(b)), share, at_rest, never }
        })
        .filter(|overlap| overlap.at_rest || overlap.never || overlap.share >= NEARLY_ALWAYS)
        .collect();
    found.sort_by_key(|overlap| overlap.pair);
    Ok(found)
}

impl Robot {
    /// Allows those pairs to touch.
    pub fn allow(&mut self, overlaps: &[Overlap]) {
        self.allowed_self_collisions.extend(overlaps.iter().map(|overlap| overlap.pair));
        self.allowed_self_collisions.sort_unstable();
        self.allowed_self_collisions.dedup();
    }
}

/// Without parry3d nothing is known of the geometry.
#[cfg(not(feature = "hulls"))]
struct Geometry;

#[cfg(not(feature = "hulls"))]
impl Geometry {
    const fn new(_: &Robot) -> Self {
        Self
    }

    #[expect(clippy::unused_self, reason = "as the one that knows")]
    const fn touch(&self, _: (usize, Pose3), _: (usize, Pose3)) -> bool {
        true
    }
}
