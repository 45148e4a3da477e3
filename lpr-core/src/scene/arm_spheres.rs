//! The robot as spheres, compiled for collision checks.

use super::close_pair::ClosePair;
use super::frames::{Frame, MovingFrame, carrier};
use super::geometry::Geometries;
use super::link_spheres::{ArmPart, LinkBits, LinkGroup, LinkSpheres, MAX_LINKS};
use super::primitive::Primitive;
use super::reach::Reach;
use super::solids::Solids;
use crate::error::{Error, Result};
use crate::robot::{JointConfig, JointRanges, Link, MAX_JOINTS, Robot, Sphere};
use fearless_simd::Level;
use glamx::Pose3;

/// Most joints that follow others.
pub(super) const MAX_FOLLOWERS: usize = 15;

/// The spheres of a robot, its kinematics in f32 and the pairs of links that may meet.
///
/// ```
/// use lpr_core::robot::PANDA;
/// use lpr_core::scene::ArmSpheres;
///
/// let arm = ArmSpheres::new(&PANDA);
/// let lowest_of_hand = arm
///     .spheres_at(&PANDA.start)
///     .filter(|(link, _)| *link == "hand")
///     .map(|(_, sphere)| sphere.center.z - sphere.radius)
///     .fold(f32::INFINITY, f32::min);
/// let grip = PANDA.grip(&PANDA.start).translation;
/// assert!(lowest_of_hand < grip.z && lowest_of_hand > grip.z - 0.05, "the fingers end just below the grip");
/// ```
#[derive(Debug, Clone)]
pub struct ArmSpheres {
    pub(crate) level: Level,
    /// All that moves, each after what it stands on.
    pub(super) moves: Vec<MovingFrame>,
    dof: usize,
    /// Index of the body that the tip is on.
    tip_body: usize,
    /// The tip in the frame of its body.
    body_from_flange: Pose3,
    limits: JointRanges,
    /// From the tip inwards: what sticks out furthest hits first.
    pub(super) links: Vec<LinkSpheres>,
    /// The same, those of a body together.
    pub(super) groups: Vec<LinkGroup>,
    /// Pairs of indices into the links that are tested against each other by their spheres.
    pub(super) self_pairs: Vec<(usize, usize)>,
    /// The same, of links that are groups by themselves.
    pub(super) lone_pairs: Vec<GroupPair<(usize, usize)>>,
    /// The others, those of two groups together.
    pub(super) group_pairs: Vec<GroupPair<Vec<(usize, usize)>>>,
    /// Those that are tested by their geometry where their spheres touch.
    pub(super) close_pairs: Vec<ClosePair>,
    /// Links of the base whose geometry is tested instead of their spheres.
    pub(super) fixed: Fixed,
    /// How far the spheres of each link can move.
    pub(super) reaches: Vec<Reach>,
}

/// Two groups of which links are tested against each other.
#[derive(Debug, Clone)]
pub(super) struct GroupPair<L> {
    /// Indices of the groups.
    pub(super) groups: (usize, usize),
    /// Indices of the links: one pair, or several.
    pub(super) links: L,
}

/// Links of the base as solids.
#[derive(Debug, Clone, Default)]
pub(super) struct Fixed {
    /// In the world; links that may touch one are allowed to.
    pub(super) solids: Solids,
    /// Index of the link of each of the solids.
    pub(super) links: Vec<usize>,
}

impl ArmSpheres {
    /// The spheres of `robot`.
    #[must_use]
    pub fn new(robot: &Robot) -> Self {
        let mut arm = Self::from_description(robot).expect("an arm that is built in or was read");
        let is_hand = |link: &&mut LinkSpheres| robot.gripper.is_some() && link.name == "hand";
        for link in arm.links.iter_mut().filter(is_hand) {
            link.part = ArmPart::Hand;
        }
        arm.group();
        arm
    }

    /// The spheres of an arm that is described at run time.
    ///
    /// ```
    /// use lpr_core::robot::{Robot, PANDA};
    /// use lpr_core::scene::{ArmSpheres, Scene};
    ///
    /// let mut chain = PANDA.described();
    /// chain.links.retain(|link| link.name != "hand");
    /// let arm = ArmSpheres::from_description(&chain)?;
    /// assert!(arm.spheres_at(&PANDA.start).all(|(link, _)| link != "hand"));
    /// assert!(Scene::empty().is_free(&arm, &PANDA.start));
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// When more than [`MAX_LINKS`] links have spheres, there are more than [`MAX_JOINTS`] joints, a frame
    /// or sphere is not finite, or a link is carried by a joint that there is not.
    pub fn from_description(chain: &Robot) -> Result<Self> {
        check_description(chain)?;
        let mut order: Vec<usize> =
            (0..chain.links.len()).filter(|&i| !chain.links[i].spheres.is_empty()).collect();
        order.sort_by_key(|&i| core::cmp::Reverse(chain.links[i].body));
        check_count(order.len())?;
        let is_tested = |&(a, b): &(usize, usize)| {
            let pair = (order[a].min(order[b]), order[a].max(order[b]));
            !chain.allowed_self_collisions.contains(&pair)
        };
        let geometries = Geometries::of(chain);
        let (close, tested): (Vec<_>, Vec<_>) = pairs(order.len())
            .filter(is_tested)
            .map(|pair| (pair, close_pair(&geometries, chain, &order, pair)))
            .partition(|(_, close)| close.is_some());
        let mut arm = Self {
            level: Level::new(),
            moves: chain.moves().iter().map(|step| MovingFrame::new(chain, step)).collect(),
            dof: chain.dof(),
            tip_body: chain.tip_body(),
            body_from_flange: Pose3::from(chain.body_from_flange),
            limits: chain.limits(),
            self_pairs: tested.into_iter().map(|(pair, _)| pair).collect(),
            close_pairs: close.into_iter().filter_map(|(_, close)| close).collect(),
            fixed: Fixed::default(),
            links: order.iter().map(|&i| LinkSpheres::of(&chain.links[i], i)).collect(),
            reaches: Vec::new(),
            groups: Vec::new(),
            lone_pairs: Vec::new(),
            group_pairs: Vec::new(),
        };
        arm.fix(order.iter().map(|&i| &chain.links[i]));
        arm.reaches =
            arm.links.iter().map(|link| Reach::new(&arm.moves, &arm.limits, link)).collect();
        arm.group();
        Ok(arm)
    }

    /// The arm with an object in its hand: `spheres` in the frame of its tip (of a built-in arm:
    /// the flange), metres.
    ///
    /// The object is tested against everything that the hand is, and against every link but those
    /// named in `touching`.
    ///
    /// A stick that reaches 20 cm beyond the fingers:
    ///
    /// ```
    /// use lpr_core::glamx::{Pose3, Vec3};
    /// use lpr_core::robot::{Sphere, XARM7};
    /// use lpr_core::scene::{ArmSpheres, Primitive, Scene};
    ///
    /// let flange_from_grip = Pose3::from(XARM7.flange_from_grip);
    /// let ball = |i: u8| Sphere { center: flange_from_grip * Vec3::new(0.0, 0.0, 0.02 * f32::from(i)), radius: 0.015 };
    /// let arm = ArmSpheres::new(&XARM7);
    /// let with_stick = arm.with_attached(&(0..=10).map(ball).collect::<Vec<_>>(), &["hand"])?;
    ///
    /// let below = XARM7.grip(&XARM7.start) * Vec3::new(0.0, 0.0, 0.2);
    /// let scene = Scene::from_primitives(vec![Primitive::Sphere { center: below, radius: 0.05 }]);
    /// assert!(scene.is_free(&arm, &XARM7.start) && !scene.is_free(&with_stick, &XARM7.start));
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// When a link in `touching` has no spheres or does not exist, a sphere is not finite, or there
    /// are too many links.
    pub fn with_attached(&self, spheres: &[Sphere], touching: &[&str]) -> Result<Self> {
        if let Some(name) =
            touching.iter().find(|name| !self.links.iter().any(|link| link.name == **name))
        {
            return Err(Error::Robot(format!("link {name}: is none that has spheres")));
        }
        if let Some(idx) = spheres.iter().position(is_broken) {
            return Err(Error::Robot(format!("attached sphere {idx}: {:?}", spheres[idx])));
        }
        let mut arm = self.clone();
        if spheres.is_empty() {
            return Ok(arm);
        }
        check_count(self.links.len() + 1)?;
        let moved =
            |s: &Sphere| Sphere { center: self.body_from_flange * s.center, radius: s.radius };
        let object = arm.links.len();
        let spheres = spheres.iter().map(moved).collect();
        arm.links.push(LinkSpheres::new("attached", self.tip_body, ArmPart::Hand, spheres));
        arm.reaches.push(Reach::new(&arm.moves, &arm.limits, &arm.links[object]));
        for (solid, &link) in self.fixed.links.iter().enumerate() {
            if touching.contains(&self.links[link].name.as_str()) {
                arm.fixed.solids.allow(solid, 1 << object);
            }
        }
        let tested = (0..object).filter(|link| {
            !touching.contains(&self.links[*link].name.as_str()) && !self.fixed.links.contains(link)
        });
        arm.self_pairs.extend(tested.map(|link| (link, object)));
        arm.group();
        Ok(arm)
    }

    /// Groups the links, and their pairs in their order.
    fn group(&mut self) {
        self.groups = LinkGroup::of(&self.links);
        (self.lone_pairs, self.group_pairs) = (Vec::new(), Vec::new());
        let group = |link: usize| self.groups.iter().position(|it| it.bits >> link & 1 == 1);
        for &(a, b) in &self.self_pairs {
            let groups = group(a).zip(group(b)).expect("every link is in a group");
            if self.groups[groups.0].is_single() && self.groups[groups.1].is_single() {
                self.lone_pairs.push(GroupPair { groups, links: (a, b) });
                continue;
            }
            match self.group_pairs.iter_mut().find(|it| it.groups == groups) {
                Some(pair) => pair.links.push((a, b)),
                None => self.group_pairs.push(GroupPair { groups, links: vec![(a, b)] }),
            }
        }
    }

    /// Tests the exact links of the base by their solids, and no longer by their spheres.
    fn fix<'a>(&mut self, links: impl Iterator<Item = &'a Link>) {
        let mut allowed = Vec::new();
        let mut solids = Vec::new();
        for (idx, link) in links.enumerate().filter(|(_, link)| link.body == 0) {
            if !link.is_exact {
                continue;
            }
            // All links that are known here but those of its pairs may touch it.
            let mut bits = LinkBits::MAX >> (LinkBits::BITS as usize - self.links.len());
            self.self_pairs.retain(|&(a, b)| {
                let is_pair = a == idx || b == idx;
                if is_pair {
                    bits &= !(1 << if a == idx { b } else { a });
                }
                !is_pair
            });
            for placed in &link.solids {
                solids.push(Primitive::of_solid(placed));
                allowed.push(bits);
                self.fixed.links.push(idx);
            }
        }
        self.fixed.solids = solids.into_iter().collect();
        for (solid, bits) in allowed.into_iter().enumerate() {
            self.fixed.solids.allow(solid, bits);
        }
    }

    /// Pairs of links that are tested against each other: by their spheres, and those of a base that
    /// is tested by its solids, which comes first.
    pub(super) fn tested_pairs(&self) -> Vec<(usize, usize)> {
        let moving = (0..self.links.len()).filter(|&idx| self.links[idx].body != 0);
        let mut with_fixed: Vec<(usize, usize)> = moving
            .flat_map(|idx| {
                let bases = self.fixed.solids.forbidden(1 << idx).map(|(solid, _)| solid);
                bases.map(move |solid| (self.fixed.links[solid], idx))
            })
            .collect();
        with_fixed.sort_unstable();
        with_fixed.dedup();
        let close: Vec<_> = self.close_pairs.iter().map(|pair| pair.links).collect();
        [&self.self_pairs[..], &close, &with_fixed].concat()
    }

    /// The bits of the links of that name, for [`super::Scene::allow_contact`].
    pub(super) fn link_bits(&self, name: &str) -> LinkBits {
        self.links
            .iter()
            .enumerate()
            .filter(|(_, link)| link.name == name)
            .fold(0, |bits, (idx, _)| bits | (1 << idx))
    }

    /// A link by its place here.
    pub(super) fn link(&self, idx: usize) -> &LinkSpheres {
        &self.links[idx]
    }

    /// Lower and upper limit of every joint, radians or metres.
    #[must_use]
    pub fn limits(&self) -> &[(f32, f32)] {
        &self.limits
    }

    /// True if the configuration has the arm's joints, each within its limits.
    pub(crate) fn is_within_limits(&self, config: &JointConfig) -> bool {
        self.has_joints_of(config)
            && (self.limits.iter().zip(config.iter()))
                .all(|((lower, upper), q)| lower <= q && q <= upper)
    }

    /// True if the configuration has as many joints as the arm.
    pub(super) fn has_joints_of(&self, config: &JointConfig) -> bool {
        config.dof() == self.dof
    }

    /// What carries a body; none of the base.
    pub(super) fn carrier(&self, body: usize) -> Option<&MovingFrame> {
        carrier(&self.moves, body)
    }

    /// Number of joints that have a motor.
    pub(super) const fn dof(&self) -> usize {
        self.dof
    }

    /// True if as many bodies as joints, and the base, are all that there is.
    pub(super) fn is_serial(&self) -> bool {
        self.moves.len() == self.dof
    }

    /// Frames of the base and of what every joint carries, in f32: quicker than
    /// [`Robot::link_frames`] and within a few micrometres of it.
    pub(super) fn frames(&self, config: &JointConfig) -> Vec<Frame> {
        let config = config.to_array::<MAX_JOINTS>();
        let mut frames = vec![Frame::IDENTITY; self.moves.len() + 1];
        for step in &self.moves {
            frames[step.body] = frames[step.parent].after(step, step.position(config[step.joint]));
        }
        frames
    }

    /// Every sphere in the world at `config`, with the name of its link.
    pub fn spheres_at(&self, config: &JointConfig) -> impl Iterator<Item = (&str, Sphere)> {
        self.placed_spheres(config).map(|(link, sphere)| (link.name.as_str(), sphere))
    }

    pub(super) fn placed_spheres(
        &self,
        config: &JointConfig,
    ) -> impl Iterator<Item = (&LinkSpheres, Sphere)> {
        let frames = self.frames(config);
        self.links.iter().flat_map(move |link| {
            let frame = frames[link.body];
            let placed = move |s: &Sphere| {
                (link, Sphere { center: frame.point(s.center), radius: s.radius })
            };
            link.clusters.iter().flat_map(|cluster| &cluster.spheres).map(placed)
        })
    }
}

/// Pairs `a < b` of `n` links.
fn pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |a| (a + 1..n).map(move |b| (a, b)))
}

/// A pair of links as one of [`Robot::close_pairs`]; none of another, and where nothing is known of
/// the geometry of one of them.
fn close_pair(
    geometries: &Geometries<'_>,
    chain: &Robot,
    order: &[usize],
    pair: (usize, usize),
) -> Option<ClosePair> {
    let (a, b) = (order[pair.0], order[pair.1]);
    if !chain.close_pairs.contains(&(a.min(b), a.max(b))) {
        return None;
    }
    let (a, b) = geometries.pair(a, b)?;
    Some(ClosePair::new(pair, (a.clone(), b.clone())))
}

fn is_broken(sphere: &Sphere) -> bool {
    !(sphere.center.is_finite() && sphere.radius.is_finite() && sphere.radius >= 0.0)
}

/// The parts of a chain are public: whoever wrote them, numbers that decide collisions are numbers.
fn check_description(chain: &Robot) -> Result<()> {
    let fault = |what: String| Err(Error::Robot(what));
    if chain.dof() > MAX_JOINTS {
        return fault(format!("{} joints, at most {MAX_JOINTS} may be", chain.dof()));
    }
    if chain.followers.len() > MAX_FOLLOWERS {
        let n = chain.followers.len();
        return fault(format!("{n} joints follow others, at most {MAX_FOLLOWERS} may"));
    }
    if let Some(joint) = chain.joints.iter().find(|joint| !joint.parent_from_joint().is_finite()) {
        return fault(format!("joint {}: its frame is not finite", joint.name));
    }
    for (k, follower) in chain.followers.iter().enumerate() {
        let numbers = [follower.multiplier, follower.offset];
        if !(follower.parent_from_joint.is_finite() && numbers.iter().all(|x| x.is_finite())) {
            return fault(format!("joint {}: its frame or motion is not finite", follower.name));
        }
        if follower.joint >= chain.dof() || follower.parent > chain.dof() + k {
            return fault(format!(
                "joint {}: what it follows or stands on does not come before it",
                follower.name
            ));
        }
    }
    for link in &chain.links {
        if link.body >= chain.n_bodies() {
            return fault(format!(
                "link {}: is on body {}, the last is {}",
                link.name,
                link.body,
                chain.n_bodies() - 1
            ));
        }
        if let Some(sphere) = link.spheres.iter().find(|sphere| is_broken(sphere)) {
            return fault(format!("link {}: {sphere:?}", link.name));
        }
    }
    Ok(())
}

fn check_count(n_links: usize) -> Result<()> {
    if n_links <= MAX_LINKS {
        return Ok(());
    }
    Err(Error::Robot(format!("{n_links} links have collision spheres, at most {MAX_LINKS} may")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{JointOrigin, ROBOTS};
    use crate::scene::Scene;
    use glamx::DPose3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn spheres_and_self_collision_agree_with_the_robot_in_f64(shares in prop::array::uniform7(0.0_f32..1.0)) {
            for robot in ROBOTS {
                let arm = ArmSpheres::new(robot);
                let joints = &robot.joints;
                let config = JointConfig::from_fn(7, |j| joints[j].lower + shares[j] * (joints[j].upper - joints[j].lower));
                let frames = robot.link_frames(&config);
                let found: Vec<Sphere> = arm.spheres_at(&config).map(|(_, sphere)| sphere).collect();
                let wanted = robot.links.iter().enumerate().flat_map(|(link, list)| list.spheres.iter().map(move |s| (link, s)));
                prop_assert_eq!(found.len(), wanted.clone().count());
                for (link, wanted) in wanted {
                    let center = frames[link] * wanted.center;
                    prop_assert!(found.iter().any(|s| s.radius == wanted.radius && s.center.distance(center) < 5e-6));
                }
                // Both compute in f32 from frames that differ by rounding: near misses aside, they
                // agree.
                if Scene::empty().is_free(&arm, &config) == robot.self_collides(&config) {
                    let grown = |by: f32| crate::scene::stick_arm::is_free_by_brute_force(robot, &Scene::empty(), &config, by);
                    prop_assert_ne!(grown(-1e-5), grown(1e-5));
                }
            }
        }
    }

    #[test]
    fn a_chain_with_a_part_that_makes_no_sense_is_refused_by_the_name_of_the_part() {
        type Change = fn(&mut Robot);
        let cases: [(Change, &str); 5] = [
            (|chain| chain.links[3].spheres[0].radius = -0.1, "link link3"),
            (|chain| chain.links[3].spheres[0].center.y = f32::NAN, "link link3"),
            (|chain| chain.links[3].body = 8, "link link3: is on body 8, the last is 7"),
            (
                |chain| {
                    let far = DPose3::translation(f64::INFINITY, 0.0, 0.0);
                    chain.joints[2].origin = JointOrigin::Fixed(far);
                },
                "joint joint3",
            ),
            (|chain| chain.joints = vec![chain.joints[0].clone(); 17], "17 joints"),
        ];
        for (change, says) in cases {
            let mut chain = ROBOTS[0].described();
            assert!(ArmSpheres::from_description(&chain).is_ok());
            change(&mut chain);
            let error = ArmSpheres::from_description(&chain).expect_err(says).to_string();
            assert!(error.contains(says), "{error}");
        }
    }

    #[test]
    fn every_arm_is_free_at_its_start() {
        for robot in ROBOTS {
            assert!(
                Scene::empty().is_free(&ArmSpheres::new(robot), &robot.start),
                "{}",
                robot.name
            );
        }
    }
}
