//! The tree of links: one root, one parent each, no loop. Nothing recurses, so that depth is
//! no matter.

use super::description::{Description, Mobility};
use crate::error::{Error, Result};
use crate::robot::xml::quoted;

/// Names that a message lists at most.
const MAX_LISTED: usize = 8;

/// The tree of a description's links.
#[derive(Debug)]
pub(super) struct Tree {
    pub(super) root: usize,
    /// Index of the joint that carries each link; none for the root.
    pub(super) joint_above: Vec<Option<usize>>,
    /// Indices of links, each after the link that it hangs on.
    pub(super) order: Vec<usize>,
    /// Number of joints between the root and each link.
    pub(super) depth: Vec<usize>,
}

impl Tree {
    pub(super) fn new(description: &Description) -> Result<Self> {
        let joint_above = joints_above(description)?;
        let roots: Vec<usize> =
            (0..joint_above.len()).filter(|&link| joint_above[link].is_none()).collect();
        let root = match roots[..] {
            [] => return Err(in_loop(description, &joint_above, 0)),
            [root] => root,
            _ => {
                return Err(Error::Robot(format!(
                    "more than one link hangs on none: {}",
                    listed(description, &roots)
                )));
            }
        };
        let order = below(description, root);
        let mut is_below = vec![false; joint_above.len()];
        order.iter().for_each(|&link| is_below[link] = true);
        match is_below.iter().position(|is_below| !is_below) {
            Some(lost) => Err(in_loop(description, &joint_above, lost)),
            None => {
                let depth = depths(description, &joint_above, &order);
                Ok(Self { root, joint_above, order, depth })
            }
        }
    }

    /// Indices of the joints from `base` to `tip`, in that order.
    pub(super) fn path(
        &self,
        description: &Description,
        base: usize,
        tip: usize,
    ) -> Result<Vec<usize>> {
        let mut joints = Vec::new();
        let mut link = tip;
        while link != base {
            let Some(joint) = self.joint_above[link] else {
                let name = |link: usize| quoted(&description.links[link].name);
                return Err(Error::Robot(format!(
                    "link {} does not hang on link {}",
                    name(tip),
                    name(base)
                )));
            };
            joints.push(joint);
            link = description.joints[joint].parent;
        }
        joints.reverse();
        Ok(joints)
    }

    /// The leaves of the tree, each with the number of driven joints between it and the root.
    pub(super) fn tips(&self, description: &Description) -> Vec<(usize, usize)> {
        let mut n_driven = vec![0_usize; self.order.len()];
        let mut is_leaf = vec![true; self.order.len()];
        for &link in &self.order {
            if let Some(joint) = self.joint_above[link].map(|joint| &description.joints[joint]) {
                n_driven[link] = n_driven[joint.parent]
                    + usize::from(matches!(joint.mobility, Mobility::Driven(_)));
                is_leaf[joint.parent] = false;
            }
        }
        (0..is_leaf.len())
            .filter(|&link| is_leaf[link])
            .map(|link| (link, n_driven[link]))
            .collect()
    }

    /// The leaf with the most driven joints between it and the root.
    pub(super) fn only_tip(&self, description: &Description) -> Result<usize> {
        let tips = self.tips(description);
        let most = tips.iter().map(|(_, n_driven)| *n_driven).max().unwrap_or(0);
        let longest: Vec<usize> =
            tips.iter().filter(|(_, n_driven)| *n_driven == most).map(|(link, _)| *link).collect();
        match longest[..] {
            [tip] => Ok(tip),
            _ => Err(Error::Robot(format!(
                "tip: expected the name of one of the links {}, found none",
                listed(description, &longest)
            ))),
        }
    }
}

/// Numbers of joints between the root and each link.
fn depths(description: &Description, joint_above: &[Option<usize>], order: &[usize]) -> Vec<usize> {
    let mut depth = vec![0; order.len()];
    for &link in order {
        if let Some(joint) = joint_above[link] {
            depth[link] = depth[description.joints[joint].parent] + 1;
        }
    }
    depth
}

fn joints_above(description: &Description) -> Result<Vec<Option<usize>>> {
    let mut above = vec![None; description.links.len()];
    for (i, joint) in description.joints.iter().enumerate() {
        if let Some(other) = above[joint.child].replace(i) {
            let names = [other, i].map(|joint: usize| quoted(&description.joints[joint].name));
            let child = quoted(&description.links[joint.child].name);
            return Err(Error::Robot(format!(
                "link {child} is the child of two joints, {} and {}: a loop",
                names[0], names[1]
            )));
        }
    }
    Ok(above)
}

/// `root` and all links that hang on it, nearer ones first.
fn below(description: &Description, root: usize) -> Vec<usize> {
    let mut children = vec![Vec::new(); description.links.len()];
    description.joints.iter().for_each(|joint| children[joint.parent].push(joint.child));
    let mut order = vec![root];
    let mut next = 0;
    while let Some(&link) = order.get(next) {
        order.append(&mut children[link]);
        next += 1;
    }
    order
}

/// Upwards from a link that no root carries: after as many steps as there are links, the way is
/// within the loop.
fn in_loop(description: &Description, joint_above: &[Option<usize>], from: usize) -> Error {
    let above =
        |link: usize| joint_above[link].map_or(link, |joint| description.joints[joint].parent);
    let link = (0..joint_above.len()).fold(from, |link, _| above(link));
    Error::Robot(format!("link {} hangs on itself: a loop", quoted(&description.links[link].name)))
}

/// Names of links, the first few of them.
pub(super) fn listed(description: &Description, links: &[usize]) -> String {
    let names: Vec<String> =
        links.iter().take(MAX_LISTED).map(|&link| quoted(&description.links[link].name)).collect();
    let more = links.len().saturating_sub(MAX_LISTED);
    if more > 0 { format!("{} and {more} more", names.join(", ")) } else { names.join(", ") }
}
