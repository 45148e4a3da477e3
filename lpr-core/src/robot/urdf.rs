//! Arms from URDF and SRDF, as they are at run time.
//!
//! The arm is the path of joints from a base to a tip; everything else hangs rigidly on it. Of a
//! link only `<collision>` is read: spheres are used as they are, other geometry is covered by
//! spheres (`robot/fit.rs`). Inertia, visual geometry, transmissions, safety controllers and macros
//! are ignored, but for macros that were never expanded: those are an error.
//!
//! Conventions are those of the formats' documentation: `rpy` are fixed angles, an axis that is not
//! stated is x, a limit that is not stated beside one that is, 0.

mod description;
#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod tests;
mod tree;

use super::link::{Link, moved};
use super::mesh::MeshReader;
use super::model::{Robot, middle_of};
use super::srdf::Semantics;
use super::{Error, JointOrigin, MAX_JOINTS, Result, fit, xml};
use description::{Collision, Description, Drive, Mobility};
use glamx::{DPose3, DQuat, DVec3};
use std::collections::BTreeSet;
use tree::Tree;
use xml::quoted;

/// Most links with collision geometry: their pairs are listed.
const MAX_SOLID_LINKS: usize = 500;

impl Robot {
    /// The arm of a URDF, with the allowed self-collisions of an SRDF.
    ///
    /// - The tip is `tip`, or that of the SRDF's first group that is a chain, or the one leaf with
    ///   the most driven joints above it (which may be a finger: name the tip of an arm with a
    ///   gripper). The base is that group's, or the root of the URDF.
    /// - A continuous joint has the limits ±2π, and 1 rad/s if it states no velocity. Joints that
    ///   are not between base and tip stay at 0, moved into their limits; those that mimic another,
    ///   too.
    /// - With an SRDF, the pairs that it disables are allowed; without one, those of neighbouring
    ///   bodies. Pairs of one body, which cannot move against each other, always are. Only links
    ///   with geometry are in pairs.
    /// - `meshes` gives the bytes of a mesh by the file name that stands in the URDF; `.stl` and
    ///   `.obj` are understood.
    ///
    /// ```
    /// use lpr_core::robot::{Robot, JointConfig};
    ///
    /// let urdf = r#"<robot name="pointer">
    ///   <link name="base"/>
    ///   <link name="arm"><collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
    ///   <joint name="yaw" type="revolute">
    ///     <parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
    ///     <limit lower="-1" upper="1" velocity="2" effort="9"/>
    ///   </joint>
    /// </robot>"#;
    /// let arm = Robot::from_urdf(urdf, None, None, &|_| None)?;
    /// assert_eq!((arm.dof(), arm.joints[0].name.as_str(), arm.links[1].spheres.len()), (1, "yaw", 1));
    /// assert!(!arm.within_limits(&JointConfig::new([1.5, 0.0])));
    ///
    /// let broken = urdf.replace(r#"child link="arm""#, r#"child link="leg""#);
    /// let error = Robot::from_urdf(&broken, None, None, &|_| None).unwrap_err();
    /// assert_eq!(error.to_string(), "robot: joint 'yaw', <child> on line 5: there is no link 'leg'");
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::Robot`] with the element, its line and the link or joint it belongs to: XML that is
    /// malformed or has macros in it, no or several roots, a loop, a link or mesh that is missing,
    /// an unknown type or geometry, numbers that are not finite, too many or too few, limits that
    /// are missing or contradict each other, no or more than [`MAX_JOINTS`] joints, one that floats or
    /// mimics another between base and tip, and a tip that is not clear.
    pub fn from_urdf(
        urdf: &str,
        srdf: Option<&str>,
        tip: Option<&str>,
        meshes: &MeshReader<'_>,
    ) -> Result<Self> {
        let document = xml::parse("URDF", urdf)?;
        let description = Description::read(xml::robot("URDF", &document)?, meshes)?;
        let semantics =
            srdf.map(|text| Semantics::read(text, &description.link_by_name)).transpose()?;
        let tree = Tree::new(&description)?;
        let ends = semantics.as_ref().and_then(|semantics| semantics.ends);
        let tip = match (tip, ends) {
            (Some(tip), _) => link_named(&description, tip)?,
            (None, Some((_, tip))) => tip,
            (None, None) => tree.only_tip(&description)?,
        };
        let base = ends.map_or(tree.root, |(base, _)| base);
        let path = tree.path(&description, base, tip)?;
        let drives = drives(&description, &path, tip)?;
        let placed = Placed::new(&description, &tree, base, &drives);
        let links = links(&description, &placed.places)?;
        Ok(Self {
            allowed_self_collisions: allowed_pairs(&links, semantics.as_ref()),
            name: description.name,
            start: middle_of(&placed.joints),
            joints: placed.joints,
            body_from_flange: placed.places[tip].body_from_link,
            flange_from_grip: DPose3::IDENTITY,
            links,
            gripper: None,
            workspace_center: None,
        })
    }
}

fn link_named(description: &Description, name: &str) -> Result<usize> {
    let found = description.link_by_name.get(name).copied();
    found.ok_or_else(|| Error::Robot(format!("the tip {} is no link of the URDF", quoted(name))))
}

/// The drives of the joints between base and tip, by index of the joint.
fn drives(description: &Description, path: &[usize], tip: usize) -> Result<Vec<(usize, Drive)>> {
    let mut drives = Vec::new();
    for &idx in path {
        let joint = &description.joints[idx];
        let refused = |why| {
            Err(Error::Robot(format!(
                "joint {} stands between base and tip, but {why}",
                quoted(&joint.name)
            )))
        };
        match joint.mobility {
            Mobility::Fixed => {}
            Mobility::Driven(drive) => drives.push((idx, drive)),
            Mobility::Mimic(_) => return refused("mimics another joint"),
            Mobility::Free => return refused("moves in more than one direction"),
        }
    }
    let tip = quoted(&description.links[tip].name);
    match drives.len() {
        0 => Err(Error::Robot(format!("no joint moves between the base and the tip {tip}"))),
        1..=MAX_JOINTS => Ok(drives),
        n => Err(Error::Robot(format!(
            "{n} joints move between the base and the tip {tip}, at most {MAX_JOINTS} may: name another tip"
        ))),
    }
}

/// Place of a link.
#[derive(Debug, Clone, Copy)]
struct Place {
    body: usize,
    body_from_link: DPose3,
}

/// The places of all links, and the joints between the bodies.
struct Placed {
    places: Vec<Place>,
    joints: Vec<super::Joint>,
}

impl Placed {
    /// From the root downwards; the base's frame is that of body 0 wherever it is in the tree.
    fn new(description: &Description, tree: &Tree, base: usize, drives: &[(usize, Drive)]) -> Self {
        let base_from_root = root_from(description, tree, base).inverse();
        let root = Place { body: 0, body_from_link: base_from_root };
        let mut placed = Self { places: vec![root; tree.order.len()], joints: Vec::new() };
        for &link in &tree.order {
            if let Some(idx) = tree.joint_above[link] {
                let joint = &description.joints[idx];
                let drive =
                    drives.iter().find(|(driven, _)| *driven == idx).map(|(_, drive)| drive);
                placed.places[link] = placed.carry(joint, drive);
            }
            if link == base {
                // Exactly, however far it is from the root.
                placed.places[link].body_from_link = DPose3::IDENTITY;
            }
        }
        placed
    }

    /// The place of what a joint carries; a joint of the arm begins a new body.
    fn carry(&mut self, joint: &description::Joint, drive: Option<&Drive>) -> Place {
        let Place { body, body_from_link: body_from_parent } = self.places[joint.parent];
        let Some(drive) = drive else {
            return Place { body, body_from_link: body_from_parent * at_rest(joint) };
        };
        let link_from_body = DPose3::from_rotation(turn_of_z_to(drive.axis));
        self.joints.push(super::Joint {
            name: joint.name.clone(),
            origin: JointOrigin::Fixed(body_from_parent * joint.parent_from_joint * link_from_body),
            motion: drive.motion,
            lower: drive.lower,
            upper: drive.upper,
            is_continuous: drive.is_continuous,
            max_velocity: drive.max_velocity,
            max_acceleration: f32::INFINITY,
        });
        Place { body: self.joints.len(), body_from_link: link_from_body.inverse() }
    }
}

/// `root_from_link` with all joints at rest.
fn root_from(description: &Description, tree: &Tree, mut link: usize) -> DPose3 {
    let mut root_from_link = DPose3::IDENTITY;
    while let Some(joint) = tree.joint_above[link].map(|idx| &description.joints[idx]) {
        root_from_link = at_rest(joint) * root_from_link;
        link = joint.parent;
    }
    root_from_link
}

/// `parent_from_child` at position 0, moved into the limits.
fn at_rest(joint: &description::Joint) -> DPose3 {
    match joint.mobility {
        Mobility::Driven(drive) | Mobility::Mimic(drive) => {
            let joint_from_body = DPose3::from_rotation(turn_of_z_to(drive.axis));
            let position = f64::from(0.0_f32.clamp(drive.lower, drive.upper));
            joint.parent_from_joint
                * joint_from_body
                * drive.motion.transform(position)
                * joint_from_body.inverse()
        }
        Mobility::Fixed | Mobility::Free => joint.parent_from_joint,
    }
}

/// The shortest rotation that takes z to `axis`, of length 1.
fn turn_of_z_to(axis: DVec3) -> DQuat {
    let off_z_squared = axis.x * axis.x + axis.y * axis.y;
    // 1 + z without cancellation.
    let w = if axis.z > 0.0 { 1.0 + axis.z } else { off_z_squared / (1.0 - axis.z) };
    let length = libm::sqrt(off_z_squared + w * w);
    if length < 1e-12 {
        return DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    }
    DQuat::from_xyzw(-axis.y / length, axis.x / length, 0.0, w / length)
}

fn links(description: &Description, places: &[Place]) -> Result<Vec<Link>> {
    let solid = description.links.iter().filter(|link| !link.collisions.is_empty());
    let n_solid = solid.clone().count();
    if let Some(link) = solid.clone().nth(MAX_SOLID_LINKS) {
        let name = quoted(&link.name);
        return Err(Error::Robot(format!(
            "link {name}: {n_solid} links have collision geometry, at most {MAX_SOLID_LINKS} may"
        )));
    }
    let link = |(link, place): (&description::Link, &Place)| {
        let mut found = Link {
            name: link.name.clone(),
            body: place.body,
            body_from_link: place.body_from_link,
            body_from_shapes: DPose3::IDENTITY,
            spheres: Vec::new(),
            capsules: Vec::new(),
            overshoot: 0.0,
        };
        for Collision { link_from_solid, solid } in &link.collisions {
            let named = |message| Error::Robot(format!("link {}: {message}", quoted(&link.name)));
            let cover = fit::cover(solid).map_err(named)?;
            found.spheres.extend(moved(&cover.spheres, &(place.body_from_link * *link_from_solid)));
            found.overshoot = found.overshoot.max(cover.overshoot);
        }
        Ok(found)
    };
    description.links.iter().zip(places).map(link).collect()
}

fn allowed_pairs(links: &[Link], semantics: Option<&Semantics>) -> Vec<(usize, usize)> {
    let solid: Vec<usize> =
        (0..links.len()).filter(|&link| !links[link].spheres.is_empty()).collect();
    let max_apart = if semantics.is_some() { 0 } else { 1 };
    let near = |&(a, b): &(usize, usize)| links[a].body.abs_diff(links[b].body) <= max_apart;
    let pairs =
        solid.iter().enumerate().flat_map(|(i, &a)| solid[i + 1..].iter().map(move |&b| (a, b)));
    let disabled = semantics.into_iter().flat_map(|semantics| semantics.disabled.iter().copied());
    let is_pair = |&(a, b): &(usize, usize)| {
        a != b && solid.binary_search(&a).is_ok() && solid.binary_search(&b).is_ok()
    };
    let allowed: BTreeSet<_> = pairs.filter(near).chain(disabled.filter(is_pair)).collect();
    allowed.into_iter().collect()
}
