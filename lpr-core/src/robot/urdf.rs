//! Arms from URDF and SRDF, as they are at run time.
//!
//! The arm is the path of joints from a base to a tip; everything else hangs rigidly on it. Of a
//! link only `<collision>` is read: spheres are used as they are, and so are convex parts of a base;
//! other geometry is covered by spheres (`robot/fit.rs`). What moves with a joint of the arm moves (`robot/follower.rs`); all else
//! keeps its place. Inertia, visual geometry, transmissions, safety controllers and macros
//! are ignored, but for macros that were never expanded: those are an error.
//!
//! Conventions are those of the formats' documentation: `rpy` are fixed angles, an axis that is not
//! stated is x, a limit that is not stated beside one that is, 0.

mod description;
#[cfg(test)]
mod fuzz;
mod groups;
mod links;
mod pairs;
#[cfg(test)]
mod tests;
mod tree;

use super::mesh::MeshReader;
use super::model::{Robot, middle_of};
use super::srdf::Semantics;
use super::{Error, Follower, JointOrigin, MAX_JOINTS, Result, xml};
use description::{Description, Drive, Mobility};
use glamx::{DPose3, DQuat, DVec3};
use tree::Tree;
use xml::quoted;

/// What is asked of a description beside the URDF itself.
#[derive(Debug, Clone, Copy, Default)]
pub struct UrdfOptions<'a> {
    /// Text of the SRDF.
    pub srdf: Option<&'a str>,
    /// Name of the SRDF's group that is the arm.
    pub group: Option<&'a str>,
    /// Name of the link that is the tip.
    pub tip: Option<&'a str>,
    /// Keeps the limits that a continuous joint states beside, which are else ignored.
    pub limit_continuous: bool,
    /// Leaves the geometry out, for kinematics alone: no mesh is opened.
    pub without_geometry: bool,
    /// Leaves out the meshes that cannot be read, with a warning, instead of refusing.
    pub ignore_missing_meshes: bool,
    /// Furthest that spheres reach beyond their link, metres, where at most
    /// [`MAX_SPHERES`](super::MAX_SPHERES) for a solid are enough; 0.01 if none. More of it plans
    /// faster, and less leaves more room.
    pub overshoot: Option<f32>,
}

/// An arm from a description, and what else stands there.
#[derive(Debug, Clone, PartialEq)]
pub struct Described {
    /// The arm.
    pub robot: Robot,
    /// Name of the link that the arm stands on.
    pub base: String,
    /// Name of the link that is its tip.
    pub tip: String,
    /// What was left out, for reading.
    pub warnings: Vec<String>,
    /// Names of the links that carry no other, each with the number of joints between it and the root
    /// that have a motor.
    pub tips: Vec<(String, usize)>,
    /// The SRDF's groups that are chains.
    pub groups: Vec<GroupFound>,
}

/// A group of an SRDF that is a chain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GroupFound {
    /// Its name.
    pub name: String,
    /// Name of the link on which it stands.
    pub base: String,
    /// Name of the link at its end.
    pub tip: String,
    /// Number of its joints that have a motor.
    pub n_joints: usize,
}

impl Robot {
    /// The arm of a URDF, with the allowed self-collisions of an SRDF: [`Self::describe`] for those
    /// who want the arm alone.
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
    /// As [`Self::describe`].
    pub fn from_urdf(
        urdf: &str,
        srdf: Option<&str>,
        tip: Option<&str>,
        meshes: &MeshReader<'_>,
    ) -> Result<Self> {
        let options = UrdfOptions { srdf, tip, ..UrdfOptions::default() };
        Ok(Self::describe(urdf, &options, meshes)?.robot)
    }

    /// The arm of a URDF, with what an SRDF says of it.
    ///
    /// - The tip is `tip`, or that of the SRDF's `group`, or that of its group with the most joints
    ///   that is a chain, or the one leaf with the most driven joints above it (which may be a
    ///   finger: name the tip of an arm with a gripper). The base is that group's, or the root of
    ///   the URDF; the world is the frame of the root.
    /// - A continuous joint has no limits, and 1 rad/s if it states no velocity. Joints that
    ///   are not between base and tip stay at 0, moved into their limits, whatever else is said of
    ///   them. A joint that mimics another moves with it: where that one is no joint of the arm, it
    ///   stays, too.
    /// - With an SRDF, the pairs that it disables are allowed; without one, those of neighbouring
    ///   bodies. Pairs of one body, which cannot move against each other, always are. Only links
    ///   with geometry are in pairs. Links of the SRDF that are not in the URDF are a warning.
    /// - `meshes` gives the bytes of a mesh by the file name that stands in the URDF; `.stl`,
    ///   `.obj` and `.dae` are understood.
    ///
    /// ```
    /// use lpr_core::robot::{Robot, UrdfOptions};
    ///
    /// let urdf = r#"<robot name="r"><link name="a"/><link name="b"/>
    ///   <joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"#;
    /// let srdf = r#"<robot name="r"><group name="arm"><joint name="j"/></group>
    ///   <disable_collisions link1="a" link2="hat"/></robot>"#;
    /// let options = UrdfOptions { srdf: Some(srdf), group: Some("arm"), ..UrdfOptions::default() };
    /// let found = Robot::describe(urdf, &options, &|_| None)?;
    /// assert_eq!((found.robot.dof(), found.groups[0].tip.as_str()), (1, "b"));
    /// assert!(found.warnings[0].contains("'hat'"));
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::Robot`] with the element, its line and the link or joint it belongs to: XML that is
    /// malformed or has macros in it, no or several roots, a loop, a link or mesh that is missing,
    /// an unknown type or geometry, numbers that are not finite, too many or too few, limits between
    /// base and tip that are missing or contradict each other, no or more than [`MAX_JOINTS`] joints
    /// there, one that floats, and a tip or group that is not clear.
    pub fn describe(
        urdf: &str,
        options: &UrdfOptions<'_>,
        meshes: &MeshReader<'_>,
    ) -> Result<Described> {
        let urdf = xml::with_prefixes(urdf);
        let document = xml::parse("URDF", &urdf)?;
        let description =
            Description::read(xml::robot("URDF", &document)?, options.limit_continuous)?;
        let tree = Tree::new(&description)?;
        let semantics = options.srdf.map(Semantics::read).transpose()?.unwrap_or_default();
        let chains = groups::chains(&description, &tree, &semantics);
        let group = match options.group {
            Some(name) => Some(groups::named(&description, &tree, &semantics, name)?),
            None => groups::longest(&chains).cloned(),
        };
        let tip = match (options.tip, &group) {
            (Some(tip), _) => link_named(&description, &tree, tip)?,
            (None, Some(group)) => group.tip,
            (None, None) => tree.only_tip(&description)?,
        };
        // Another tip than the group's may hang beside its base.
        let base = group.as_ref().map_or(tree.root, |group| group.base);
        let path = tree.path(&description, base, tip)?;
        let drives = drives(&description, &tree, &path, tip)?;
        let placed = Placed::new(&description, &tree, &path, &drives);
        let mut warnings = warnings_of(&description, &path);
        let links = links::links(&description, &placed.places, options, meshes, &mut warnings)?;
        let mut robot = Self {
            allowed_self_collisions: Vec::new(),
            close_pairs: Vec::new(),
            name: description.name.clone(),
            start: middle_of(&placed.joints),
            joints: placed.joints,
            followers: placed.followers,
            body_from_flange: placed.places[tip].body_from_link,
            flange_from_grip: DPose3::IDENTITY,
            links,
            gripper: None,
            workspace_center: None,
        };
        robot.allowed_self_collisions = pairs::allowed(
            &robot,
            options.srdf.map(|_| &semantics),
            &description.link_by_name,
            &mut warnings,
        );
        let name = |link: usize| description.links[link].name.clone();
        let group = |chain: groups::Chain| GroupFound {
            base: name(chain.base),
            tip: name(chain.tip),
            name: chain.name,
            n_joints: chain.n_driven,
        };
        let tips = tree.tips(&description).into_iter().map(|(link, n)| (name(link), n));
        Ok(Described {
            robot,
            base: name(base),
            tip: name(tip),
            warnings,
            tips: tips.collect(),
            groups: chains.into_iter().map(group).collect(),
        })
    }
}

/// What is amiss with joints and no reason to refuse the arm.
fn warnings_of(description: &Description, path: &[usize]) -> Vec<String> {
    let mut warnings = Vec::new();
    for joint in path.iter().map(|&idx| &description.joints[idx]) {
        if joint.lacks_velocity && matches!(joint.mobility, Mobility::Driven(_)) {
            warnings.push(format!(
                "joint {}: expected a velocity limit above 0, found none: 1 is taken",
                quoted(&joint.name)
            ));
        }
    }
    let faults: Vec<String> = description
        .joints
        .iter()
        .filter_map(|joint| Some(joint.fault.as_ref()?.to_string()))
        .collect();
    if let Some(first) = faults.first() {
        let n = faults.len();
        warnings.push(format!("{n} joints beside the arm stand still, the first: {first}"));
    }
    warnings
}

fn link_named(description: &Description, tree: &Tree, name: &str) -> Result<usize> {
    description.link_by_name.get(name).copied().ok_or_else(|| {
        let tips: Vec<usize> = tree.tips(description).iter().map(|(link, _)| *link).collect();
        Error::Robot(format!(
            "tip: expected a link of the URDF, as {}, found {}",
            tree::listed(description, &tips),
            quoted(name)
        ))
    })
}

/// The drives of the joints between base and tip, by index of the joint.
fn drives(
    description: &Description,
    tree: &Tree,
    path: &[usize],
    tip: usize,
) -> Result<Vec<(usize, Drive)>> {
    let mut drives = Vec::new();
    for &idx in path {
        let joint = &description.joints[idx];
        match (joint.mobility, &joint.fault) {
            (_, Some(fault)) => return Err(fault.clone()),
            (Mobility::Fixed, None) => {}
            (Mobility::Driven(drive), None) => drives.push((idx, drive)),
            (Mobility::Mimic(..), None) => {}
            (Mobility::Free, None) => {
                return Err(Error::Robot(format!(
                    "joint {} stands between base and tip, but moves in more than one direction",
                    quoted(&joint.name)
                )));
            }
        }
    }
    let name = quoted(&description.links[tip].name);
    match drives.len() {
        0 => {
            let moving = tree.tips(description).into_iter().filter(|(_, n_driven)| *n_driven > 0);
            let moving: Vec<usize> = moving.map(|(link, _)| link).collect();
            let others = if moving.is_empty() {
                "no joint of the file moves".to_owned()
            } else {
                format!("tips that move are {}", tree::listed(description, &moving))
            };
            Err(Error::Robot(format!(
                "no joint moves between the base and the tip {name}: {others}"
            )))
        }
        1..=MAX_JOINTS => Ok(drives),
        n => Err(Error::Robot(format!(
            "{n} joints move between the base and the tip {name}, at most {MAX_JOINTS} may: name another tip"
        ))),
    }
}

/// Place of a link.
#[derive(Debug, Clone, Copy)]
struct Place {
    body: usize,
    body_from_link: DPose3,
}

/// The places of all links, and what moves the bodies.
struct Placed {
    places: Vec<Place>,
    joints: Vec<super::Joint>,
    followers: Vec<Follower>,
}

impl Placed {
    /// From the root downwards, whose frame is that of body 0: wherever in the tree the arm's base is,
    /// obstacles and poses are in the frame of the whole robot, as in other programs.
    fn new(
        description: &Description,
        tree: &Tree,
        path: &[usize],
        drives: &[(usize, Drive)],
    ) -> Self {
        let root = Place { body: 0, body_from_link: DPose3::IDENTITY };
        let mut placed = Self {
            places: vec![root; tree.order.len()],
            joints: Vec::new(),
            followers: Vec::new(),
        };
        for &link in &tree.order {
            if let Some(idx) = tree.joint_above[link] {
                placed.places[link] = placed.carry(description, idx, path, drives);
            }
        }
        placed
    }

    /// The place of what a joint carries; a joint of the arm, and one that follows it, begins a new
    /// body.
    fn carry(
        &mut self,
        description: &Description,
        idx: usize,
        path: &[usize],
        drives: &[(usize, Drive)],
    ) -> Place {
        let joint = &description.joints[idx];
        let Place { body, body_from_link: body_from_parent } = self.places[joint.parent];
        let of_arm = |idx: usize| drives.iter().position(|(driven, _)| *driven == idx);
        let frame = |drive: &Drive| {
            let link_from_body = DPose3::from_rotation(turn_of_z_to(drive.axis));
            (body_from_parent * joint.parent_from_joint * link_from_body, link_from_body.inverse())
        };
        match joint.mobility {
            Mobility::Driven(drive) if of_arm(idx).is_some() => {
                let (body_from_joint, body_from_link) = frame(&drive);
                self.joints.push(super::Joint {
                    name: joint.name.clone(),
                    origin: JointOrigin::Fixed(body_from_joint),
                    motion: drive.motion,
                    lower: drive.lower,
                    upper: drive.upper,
                    is_continuous: drive.is_continuous,
                    max_velocity: drive.max_velocity,
                    max_acceleration: f32::INFINITY,
                });
                Place { body: self.joints.len(), body_from_link }
            }
            Mobility::Mimic(drive, mimic) => match of_arm(mimic.driver) {
                Some(driver) => {
                    let (parent_from_joint, body_from_link) = frame(&drive);
                    self.followers.push(Follower {
                        name: joint.name.clone(),
                        parent: body,
                        parent_from_joint,
                        motion: drive.motion,
                        joint: driver,
                        multiplier: mimic.multiplier,
                        offset: mimic.offset,
                        is_in_chain: path.contains(&idx),
                    });
                    Place { body: drives.len() + self.followers.len(), body_from_link }
                }
                None => {
                    Place { body, body_from_link: body_from_parent * at_rest(description, joint) }
                }
            },
            Mobility::Driven(_) | Mobility::Fixed | Mobility::Free => {
                Place { body, body_from_link: body_from_parent * at_rest(description, joint) }
            }
        }
    }
}

/// `parent_from_child` at position 0, moved into the limits; of a joint that follows another, where
/// it is then.
fn at_rest(description: &Description, joint: &description::Joint) -> DPose3 {
    let rest = |drive: Drive| f64::from(0.0_f32.clamp(drive.lower, drive.upper));
    let (drive, position) = match joint.mobility {
        Mobility::Driven(drive) => (drive, rest(drive)),
        Mobility::Mimic(drive, mimic) => {
            let driver = match description.joints[mimic.driver].mobility {
                Mobility::Driven(driver) => rest(driver),
                Mobility::Mimic(..) | Mobility::Fixed | Mobility::Free => 0.0,
            };
            (drive, mimic.multiplier * driver + mimic.offset)
        }
        Mobility::Fixed | Mobility::Free => return joint.parent_from_joint,
    };
    let joint_from_body = DPose3::from_rotation(turn_of_z_to(drive.axis));
    joint.parent_from_joint
        * joint_from_body
        * drive.motion.transform(position)
        * joint_from_body.inverse()
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
