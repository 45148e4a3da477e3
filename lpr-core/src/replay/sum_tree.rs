//! A binary tree over masses whose every node is the sum of its children.

/// Masses per slot, drawn from in logarithmic time.
#[derive(Debug, Clone)]
pub(super) struct SumTree {
    n_leaves: usize,
    /// Root at 1, children of `k` at `2 k` and `2 k + 1`, leaves last.
    nodes: Vec<f64>,
}

impl SumTree {
    /// All masses zero.
    pub(super) fn new(n_slots: usize) -> Self {
        let n_leaves = n_slots.next_power_of_two();
        Self { n_leaves, nodes: vec![0.0; 2 * n_leaves] }
    }

    pub(super) fn total(&self) -> f64 {
        self.nodes[1]
    }

    pub(super) fn get(&self, slot: usize) -> f64 {
        self.nodes[self.n_leaves + slot]
    }

    pub(super) fn set(&mut self, slot: usize, mass: f64) {
        let mut node = self.n_leaves + slot;
        self.nodes[node] = mass;
        while node > 1 {
            node /= 2;
            // Summed anew instead of adding the difference: no error builds up.
            self.nodes[node] = self.nodes[2 * node] + self.nodes[2 * node + 1];
        }
    }

    /// The slot in which `at` falls when the masses lie side by side; never one without mass as
    /// long as any has mass.
    pub(super) fn find(&self, mut at: f64) -> usize {
        let mut node = 1;
        while node < self.n_leaves {
            let (left, right) = (self.nodes[2 * node], self.nodes[2 * node + 1]);
            // Rounding may put `at` at the end of the total: nothing lies right of it then.
            if at < left || right <= 0.0 {
                node *= 2;
            } else {
                at -= left;
                node = 2 * node + 1;
            }
        }
        node - self.n_leaves
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_total_is_the_sum_of_the_masses(changes in prop::collection::vec((0_usize..13, 0.0_f64..10.0), 1..60)) {
            let mut tree = SumTree::new(13);
            let mut masses = [0.0; 13];
            for (slot, mass) in changes {
                tree.set(slot, mass);
                masses[slot] = mass;
            }
            let sum: f64 = masses.iter().sum();
            prop_assert!((tree.total() - sum).abs() < 1e-9);
        }

        #[test]
        fn a_slot_is_found_between_the_sums_around_it(masses in prop::collection::vec(0.0_f64..5.0, 1..20), at in 0.0_f64..1.0) {
            let mut tree = SumTree::new(masses.len());
            masses.iter().enumerate().for_each(|(slot, &mass)| tree.set(slot, mass));
            let at = at * tree.total();
            let slot = tree.find(at);
            let before: f64 = masses[..slot].iter().sum();
            prop_assert!(before <= at + 1e-9 && at <= before + masses[slot] + 1e-9, "{} in slot {}", at, slot);
        }
    }

    #[test]
    fn a_slot_without_mass_is_never_found() {
        let mut tree = SumTree::new(5);
        tree.set(1, 2.0);
        tree.set(3, 1.0);
        assert_eq!([0.0, 1.9, 2.0, 2.9, 3.0, 3.5].map(|at| tree.find(at)), [1, 1, 3, 3, 3, 3]);
    }
}
