//! The buffer: rows, their priorities and the draws from them.

use super::sum_tree::SumTree;
use crate::check::setting;
use crate::error::{Error, Result};
use crate::rng::Rng;

use rand::RngExt as _;
use serde::{Deserialize, Serialize};

/// Added to every priority so that no row is lost for good (`ε` in Schaul et al.).
const PRIORITY_FLOOR: f32 = 1e-5;

/// Settings of the replay buffer's sampling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplaySettings {
    /// Rows kept; the oldest is overwritten first.
    pub capacity: usize,
    /// Exponent of priorities: 0 samples uniformly (`α` in Schaul et al.).
    pub priority_exponent: f32,
    /// Exponent of importance weights: 1 corrects the bias of the sampling fully (`β` in Schaul et
    /// al.).
    pub importance_exponent: f32,
}

impl ReplaySettings {
    /// The same buffer without priorities.
    #[must_use]
    pub fn uniform(&self) -> Self {
        Self { priority_exponent: 0.0, ..self.clone() }
    }

    /// Checks the ranges of all numbers.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] without capacity, or with a negative exponent.
    pub fn check(&self) -> Result<()> {
        setting(self.capacity >= 1, "replay.capacity", "at least 1", self.capacity)?;
        for (name, exponent) in [
            ("replay.priority_exponent", self.priority_exponent),
            ("replay.importance_exponent", self.importance_exponent),
        ] {
            let holds = exponent.is_finite() && exponent >= 0.0;
            setting(holds, name, "a finite number from 0", exponent)?;
        }
        Ok(())
    }
}

/// A ring of rows that are drawn in proportion to their priorities.
#[derive(Debug, Clone)]
pub struct Replay<T> {
    settings: ReplaySettings,
    rows: Vec<T>,
    added: u64,
    priorities: Vec<f32>,
    max_priority: f32,
    /// `priority ^ α` per slot.
    tree: SumTree,
}

/// A row that was drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draw {
    /// Number of rows that were added before it: names the row even after its slot was overwritten.
    pub row: u64,
    /// Importance weight, at most 1, where 1 is the largest of the batch.
    pub weight: f32,
}

/// Everything but the rows: part of a checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplayState {
    /// Rows added so far, overwritten ones included.
    pub added: u64,
    /// Priority of each row, in the order of [`Replay::rows`].
    pub priorities: Vec<f32>,
    /// Priority of the next new row.
    pub max_priority: f32,
}

impl<T> Replay<T> {
    /// An empty buffer.
    ///
    /// # Errors
    ///
    /// As [`ReplaySettings::check`].
    pub fn new(settings: &ReplaySettings) -> Result<Self> {
        settings.check()?;
        Ok(Self {
            settings: settings.clone(),
            rows: Vec::new(),
            added: 0,
            priorities: Vec::new(),
            max_priority: 1.0,
            tree: SumTree::new(settings.capacity),
        })
    }

    /// Adds a row with the largest priority so far, over the oldest row when full.
    pub fn push(&mut self, row: T) {
        let slot = self.slot(self.added);
        if slot == self.rows.len() {
            self.rows.push(row);
            self.priorities.push(self.max_priority);
        } else {
            self.rows[slot] = row;
            self.priorities[slot] = self.max_priority;
        }
        self.tree.set(slot, self.mass(self.max_priority));
        self.added += 1;
    }

    /// Draws `batch_size` rows with replacement; none when the buffer is empty.
    pub fn sample(&self, batch_size: usize, rng: &mut Rng) -> Vec<Draw> {
        if self.rows.is_empty() {
            return Vec::new();
        }
        let slots: Vec<_> = (0..batch_size)
            .map(|_| self.tree.find(rng.random::<f64>() * self.tree.total()))
            .collect();
        // The factor `n` of (n P)^-β cancels with the division by the largest weight.
        let weight = |slot: usize| {
            libm::pow(self.tree.get(slot), -f64::from(self.settings.importance_exponent))
        };
        let largest = slots.iter().map(|&slot| weight(slot)).fold(0.0, f64::max);
        slots
            .into_iter()
            .map(|slot| Draw { row: self.row_of(slot), weight: (weight(slot) / largest) as f32 })
            .collect()
    }

    /// The row that a draw names, unless it was overwritten since.
    #[must_use]
    pub fn get(&self, draw: Draw) -> Option<&T> {
        self.is_held(draw.row).then(|| &self.rows[self.slot(draw.row)])
    }

    /// Sets new priorities, usually the absolute temporal differences; overwritten rows are
    /// skipped.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] when the numbers differ, or when a priority is negative or not finite;
    /// nothing changes then.
    pub fn update_priorities(&mut self, draws: &[Draw], priorities: &[f32]) -> Result<()> {
        if draws.len() != priorities.len() {
            let (expected, found) = (draws.len().to_string(), priorities.len().to_string());
            return Err(Error::Shape { what: "priorities", expected, found });
        }
        if let Some(priority) =
            priorities.iter().find(|priority| !(priority.is_finite() && **priority >= 0.0))
        {
            let expected = "finite numbers from 0".to_owned();
            return Err(Error::Shape { what: "priorities", expected, found: priority.to_string() });
        }
        for (draw, priority) in draws.iter().zip(priorities) {
            if self.is_held(draw.row) {
                let (slot, priority) = (self.slot(draw.row), priority + PRIORITY_FLOOR);
                self.priorities[slot] = priority;
                self.max_priority = self.max_priority.max(priority);
                self.tree.set(slot, self.mass(priority));
            }
        }
        Ok(())
    }

    /// All rows in the order of their slots: by age until the ring closes.
    #[must_use]
    pub fn rows(&self) -> &[T] {
        &self.rows
    }

    /// Rows added so far, overwritten ones included.
    #[must_use]
    pub const fn added(&self) -> u64 {
        self.added
    }

    /// The part of a checkpoint beside the rows.
    #[must_use]
    pub fn state(&self) -> ReplayState {
        ReplayState {
            added: self.added,
            priorities: self.priorities.clone(),
            max_priority: self.max_priority,
        }
    }

    /// The buffer of a checkpoint, with `rows` in the order of [`Replay::rows`].
    ///
    /// # Errors
    ///
    /// [`Error::Checkpoint`] when rows, priorities and the count contradict each other or the
    /// capacity.
    pub fn restore(settings: &ReplaySettings, rows: Vec<T>, state: ReplayState) -> Result<Self> {
        let mut replay = Self::new(settings)?;
        let held = usize::try_from(state.added)
            .map_or(settings.capacity, |added| added.min(settings.capacity));
        if rows.len() != held || state.priorities.len() != held {
            return Err(Error::Checkpoint(format!(
                "replay: expected {held} rows and priorities, found {} and {}",
                rows.len(),
                state.priorities.len()
            )));
        }
        let all = state.priorities.iter().chain([&state.max_priority]);
        if let Some(priority) =
            all.into_iter().find(|priority| !(priority.is_finite() && **priority > 0.0))
        {
            return Err(Error::Checkpoint(format!(
                "replay: expected positive priorities, found {priority}"
            )));
        }
        for (slot, &priority) in state.priorities.iter().enumerate() {
            replay.tree.set(slot, replay.mass(priority));
        }
        let ReplayState { added, priorities, max_priority } = state;
        Ok(Self { rows, added, priorities, max_priority, ..replay })
    }

    fn mass(&self, priority: f32) -> f64 {
        libm::pow(f64::from(priority), f64::from(self.settings.priority_exponent))
    }

    const fn slot(&self, row: u64) -> usize {
        (row % self.settings.capacity as u64) as usize
    }

    const fn is_held(&self, row: u64) -> bool {
        row < self.added && self.added - row <= self.settings.capacity as u64
    }

    /// The newest row in `slot`.
    const fn row_of(&self, slot: usize) -> u64 {
        let capacity = self.settings.capacity as u64;
        let newest = self.added - 1;
        newest - (newest + capacity - slot as u64) % capacity
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use proptest::prelude::*;

    fn settings(capacity: usize) -> ReplaySettings {
        ReplaySettings { capacity, priority_exponent: 1.0, importance_exponent: 1.0 }
    }

    fn filled(capacity: usize, n_rows: u32) -> Replay<u32> {
        let mut replay = Replay::new(&settings(capacity)).expect("valid settings");
        (0..n_rows).for_each(|row| replay.push(row));
        replay
    }

    fn draw(row: u64) -> Draw {
        Draw { row, weight: 1.0 }
    }

    #[test]
    fn rows_are_drawn_as_often_as_their_priorities_say() {
        let mut replay = filled(8, 5);
        let priorities = [1.0, 2.0, 0.0, 4.0, 3.0];
        replay.update_priorities(&[0, 1, 2, 3, 4].map(draw), &priorities).expect("five priorities");
        let draws = replay.sample(20_000, &mut stream(5, Stream::Replay, 0));
        let mut counts = [0_u32; 5];
        draws.iter().for_each(|draw| counts[*replay.get(*draw).expect("held") as usize] += 1);
        for (count, priority) in counts.iter().zip(priorities) {
            // 210: three standard deviations at p = 0.4.
            let expected = 20_000.0 * priority / 10.0;
            assert!((*count as f32 - expected).abs() < 210.0, "{counts:?}");
        }
    }

    #[test]
    fn importance_weights_undo_the_priorities() {
        let mut replay = filled(4, 4);
        replay
            .update_priorities(&[0, 1, 2, 3].map(draw), &[1.0, 2.0, 4.0, 8.0])
            .expect("four priorities");
        let draws = replay.sample(200, &mut stream(1, Stream::Replay, 0));
        let weighted = |draw: &Draw| draw.weight * replay.state().priorities[draw.row as usize];
        let first = weighted(&draws[0]);
        assert!(draws.iter().all(|draw| (weighted(draw) / first - 1.0).abs() < 1e-5));
        assert!(draws.iter().any(|draw| draw.weight == 1.0));
    }

    #[test]
    fn a_new_row_has_the_largest_priority_ever() {
        let mut replay = filled(4, 2);
        replay.update_priorities(&[draw(0)], &[7.0]).expect("one priority");
        replay.update_priorities(&[draw(0)], &[0.5]).expect("one priority");
        replay.push(2);
        assert_eq!(replay.state().priorities[2], 7.0 + PRIORITY_FLOOR);
    }

    #[test]
    fn an_overwritten_row_is_gone_and_its_priority_ignored() {
        let mut replay = filled(3, 4);
        assert_eq!(replay.rows(), [3, 1, 2]);
        assert_eq!(replay.get(draw(0)), None);
        assert_eq!(replay.get(draw(3)), Some(&3));
        let before = replay.state();
        replay.update_priorities(&[draw(0)], &[9.0]).expect("one priority");
        assert_eq!(replay.state(), before);
    }

    #[test]
    fn broken_input_is_an_error() {
        assert!(Replay::<u32>::new(&settings(0)).is_err());
        let mut replay = filled(3, 3);
        assert!(replay.update_priorities(&[draw(0)], &[]).is_err());
        assert!(replay.update_priorities(&[draw(0)], &[f32::NAN]).is_err());
        assert!(Replay::restore(&settings(3), vec![1_u32], replay.state()).is_err());
        assert!(
            Replay::<u32>::new(&settings(3))
                .expect("valid")
                .sample(4, &mut stream(0, Stream::Replay, 0))
                .is_empty()
        );
    }

    proptest! {
        #[test]
        fn a_restored_buffer_draws_the_same(capacity in 1_usize..20, n_rows in 1_u32..60, seed in 0_u64..1000) {
            let mut replay = filled(capacity, n_rows);
            let first = replay.sample(8, &mut stream(seed, Stream::Replay, 0));
            let priorities: Vec<_> = first.iter().map(|draw| draw.row as f32 * 0.1).collect();
            replay.update_priorities(&first, &priorities).expect("eight priorities");
            let restored = Replay::restore(&settings(capacity), replay.rows().to_vec(), replay.state()).expect("its own state");
            let draws = |replay: &Replay<u32>| replay.sample(16, &mut stream(seed, Stream::Replay, 1));
            prop_assert_eq!(draws(&replay), draws(&restored));
            for draw in draws(&replay) {
                prop_assert_eq!(replay.get(draw).copied().map(u64::from), Some(draw.row));
            }
        }
    }
}
