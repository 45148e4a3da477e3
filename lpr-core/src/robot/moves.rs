//! All that moves of an arm: its joints, and those that follow them.

use super::{Follower, Robot};

/// Something that moves one body against another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Move<'a> {
    /// Body that it stands on.
    pub(crate) parent: usize,
    /// Body that it carries.
    pub(crate) body: usize,
    /// Index of the joint whose position counts.
    pub(crate) joint: usize,
    /// A joint that follows; none for the joint itself.
    pub(crate) follower: Option<&'a Follower>,
    /// True between base and tip.
    pub(crate) is_in_chain: bool,
}

impl Robot {
    /// Number of bodies, the base among them.
    pub(crate) const fn n_bodies(&self) -> usize {
        1 + self.joints.len() + self.followers.len()
    }

    /// All that moves, each after what it stands on.
    pub(crate) fn moves(&self) -> Vec<Move<'_>> {
        let mut moves = Vec::with_capacity(self.n_bodies());
        let mut standing_on = 0;
        for j in 0..=self.dof() {
            for (k, follower) in self.followers.iter().enumerate() {
                if self.n_before(follower) == j {
                    let body = 1 + self.dof() + k;
                    let Follower { parent, joint, is_in_chain, .. } = *follower;
                    moves.push(Move { parent, body, joint, follower: Some(follower), is_in_chain });
                    standing_on = if is_in_chain { body } else { standing_on };
                }
            }
            if j < self.dof() {
                let (parent, body) = (standing_on, j + 1);
                moves.push(Move { parent, body, joint: j, follower: None, is_in_chain: true });
                standing_on = body;
            }
        }
        moves
    }

    /// Number of joints between a follower and the base.
    fn n_before(&self, follower: &Follower) -> usize {
        let mut parent = follower.parent;
        // Parents come before: every step leads to an earlier follower, or ends.
        for _ in 0..self.followers.len() {
            match parent.checked_sub(self.dof() + 1) {
                Some(k) => parent = self.followers[k].parent,
                None => break,
            }
        }
        parent.min(self.dof())
    }

    /// Index of the body that the flange is on.
    pub(crate) fn tip_body(&self) -> usize {
        let last = self
            .followers
            .iter()
            .rposition(|follower| follower.is_in_chain && self.n_before(follower) == self.dof());
        last.map_or(self.dof(), |k| 1 + self.dof() + k)
    }
}
