//! One configuration of an arm of up to [`MAX_JOINTS`] joints.

use arrayvec::ArrayVec;
use core::fmt;
use core::ops::{Deref, DerefMut};
use serde::de::{Error as _, SeqAccess, Visitor};
use serde::ser::SerializeTuple as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Most joints of an arm.
pub const MAX_JOINTS: usize = 16;

/// Number of joints whose configurations are written without a mark: what was written before arms
/// of other sizes existed opens.
const UNMARKED: usize = 7;
/// Bits of the quiet NaN that begins a configuration of another size; the lowest byte is the number
/// of joints.
const MARK: u32 = 0x7fc0_4a00;

/// A lower and an upper limit for each joint, radians or metres.
pub type JointRanges = ArrayVec<(f32, f32), MAX_JOINTS>;

/// One configuration of an arm: a position for each joint, radians or metres.
///
/// It is `Copy` and lives without the heap. Two configurations are equal when they have the same
/// joints at the same positions.
///
/// ```
/// use lpr_core::robot::{JointConfig, XARM7};
///
/// let mut config = XARM7.start;
/// config[0] += 0.3;
/// assert_eq!(config.len(), 7);
/// assert!((config.distance(&XARM7.start) - 0.3).abs() < 1e-6);
/// assert_ne!(JointConfig::new([0.0; 7]), JointConfig::new([0.0; 8]));
/// ```
///
/// # Format
///
/// An array of numbers. Formats without lengths hold the seven numbers of an arm of seven joints
/// alone; those of any other arm follow a NaN whose lowest byte is how many there are.
#[derive(Clone, Copy, PartialEq)]
pub struct JointConfig {
    /// Those beyond the last joint are 0, so that derived equality is right.
    values: [f32; MAX_JOINTS],
    dof: u8,
}

impl JointConfig {
    /// The configuration of an arm of `N` joints, at most [`MAX_JOINTS`].
    #[must_use]
    pub const fn new<const N: usize>(values: [f32; N]) -> Self {
        const { assert!(N <= MAX_JOINTS, "an arm has at most 16 joints") };
        let mut config = Self { values: [0.0; MAX_JOINTS], dof: N as u8 };
        let mut j = 0;
        while j < N {
            config.values[j] = values[j];
            j += 1;
        }
        config
    }

    /// The configuration of an arm with as many joints as there are values; `None` for more than
    /// [`MAX_JOINTS`].
    #[must_use]
    pub fn from_slice(values: &[f32]) -> Option<Self> {
        (values.len() <= MAX_JOINTS).then(|| Self::from_fn(values.len(), |j| values[j]))
    }

    /// The configuration of `dof` joints whose positions `f` gives.
    ///
    /// # Panics
    ///
    /// When `dof` is above [`MAX_JOINTS`].
    #[must_use]
    #[inline]
    pub fn from_fn(dof: usize, mut f: impl FnMut(usize) -> f32) -> Self {
        let mut values = [0.0; MAX_JOINTS];
        for (j, value) in values[..dof].iter_mut().enumerate() {
            *value = f(j);
        }
        Self { values, dof: dof as u8 }
    }

    /// Number of joints.
    #[must_use]
    #[inline]
    pub const fn dof(&self) -> usize {
        self.dof as usize
    }

    /// The positions of the first `N` joints: all of an arm that has so many, 0 where there are
    /// fewer.
    #[must_use]
    #[inline]
    pub fn to_array<const N: usize>(&self) -> [f32; N] {
        const { assert!(N <= MAX_JOINTS, "an arm has at most 16 joints") };
        core::array::from_fn(|j| self.values[j])
    }

    /// Every position replaced by `f` of it.
    ///
    /// ```
    /// use lpr_core::robot::JointConfig;
    ///
    /// assert_eq!(JointConfig::new([0.5, -1.0]).map(|q| 2.0 * q), JointConfig::new([1.0, -2.0]));
    /// ```
    #[must_use]
    #[inline]
    pub fn map(&self, mut f: impl FnMut(f32) -> f32) -> Self {
        Self::from_fn(self.dof(), |j| f(self.values[j]))
    }

    /// Euclidean distance in joint space, radians.
    #[must_use]
    #[inline]
    pub fn distance(&self, other: &Self) -> f32 {
        let squares: f32 = self.iter().zip(other.iter()).map(|(a, b)| (a - b) * (a - b)).sum();
        libm::sqrtf(squares)
    }

    /// Largest difference of one joint, radians.
    ///
    /// ```
    /// use lpr_core::robot::JointConfig;
    ///
    /// let (rest, bent) = (JointConfig::new([0.0; 3]), JointConfig::new([0.3, -0.4, 0.0]));
    /// assert_eq!(rest.max_joint_distance(&bent), 0.4);
    /// assert_eq!(rest.distance(&bent), 0.5);
    /// ```
    #[must_use]
    #[inline]
    pub fn max_joint_distance(&self, other: &Self) -> f32 {
        self.iter().zip(other.iter()).fold(0.0, |most, (a, b)| (a - b).abs().max(most))
    }

    /// The point at `fraction` of the straight joint-space line from `self` to `other`.
    ///
    /// ```
    /// use lpr_core::robot::XARM7;
    ///
    /// let goal = XARM7.start.map(|q| q + 0.5);
    /// let quarter = XARM7.start.lerp(&goal, 0.25);
    /// assert!(quarter.iter().zip(XARM7.start.iter()).all(|(q, start)| (q - start - 0.125).abs() < 1e-6));
    /// ```
    #[must_use]
    #[inline]
    pub fn lerp(&self, other: &Self, fraction: f32) -> Self {
        Self::from_fn(self.dof(), |j| {
            self.values[j] + (other.values[j] - self.values[j]) * fraction
        })
    }

    /// True if every joint is a finite number.
    #[must_use]
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.iter().all(|q| q.is_finite())
    }
}

impl<const N: usize> From<[f32; N]> for JointConfig {
    fn from(values: [f32; N]) -> Self {
        Self::new(values)
    }
}

impl Deref for JointConfig {
    type Target = [f32];
    #[inline]
    fn deref(&self) -> &[f32] {
        &self.values[..usize::from(self.dof)]
    }
}

impl DerefMut for JointConfig {
    #[inline]
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.values[..usize::from(self.dof)]
    }
}

impl fmt::Debug for JointConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JointConfig")?;
        f.debug_list().entries(self.iter()).finish()
    }
}

impl Serialize for JointConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let is_marked = !serializer.is_human_readable() && self.dof() != UNMARKED;
        let mut tuple = serializer.serialize_tuple(self.dof() + usize::from(is_marked))?;
        if is_marked {
            tuple.serialize_element(&f32::from_bits(MARK | u32::from(self.dof)))?;
        }
        self.iter().try_for_each(|q| tuple.serialize_element(q))?;
        tuple.end()
    }
}

impl<'de> Deserialize<'de> for JointConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        if deserializer.is_human_readable() {
            return deserializer.deserialize_seq(Numbers);
        }
        deserializer.deserialize_tuple(MAX_JOINTS + 1, Marked)
    }
}

/// As many numbers as there are.
struct Numbers;

impl<'de> Visitor<'de> for Numbers {
    type Value = JointConfig;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "an array of 1 to {MAX_JOINTS} joint positions")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> Result<JointConfig, A::Error> {
        let mut config = JointConfig { values: [0.0; MAX_JOINTS], dof: 0 };
        while let Some(q) = numbers.next_element()? {
            if config.dof() == MAX_JOINTS {
                return Err(A::Error::invalid_length(MAX_JOINTS + 1, &self));
            }
            config.values[config.dof()] = q;
            config.dof += 1;
        }
        if config.is_empty() { Err(A::Error::invalid_length(0, &self)) } else { Ok(config) }
    }
}

/// Seven numbers, or the mark and as many as it says.
struct Marked;

impl<'de> Visitor<'de> for Marked {
    type Value = JointConfig;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("seven joint positions, or a mark and as many as it says")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> Result<JointConfig, A::Error> {
        let mut next = |idx| {
            numbers.next_element::<f32>()?.ok_or_else(|| A::Error::invalid_length(idx, &self))
        };
        let first = next(0)?;
        let mut config = JointConfig { values: [0.0; MAX_JOINTS], dof: UNMARKED as u8 };
        let n_read = match first.to_bits() {
            bits if bits & !0xff == MARK => {
                config.dof = bits as u8;
                if config.dof() > MAX_JOINTS {
                    return Err(A::Error::invalid_length(config.dof(), &self));
                }
                0
            }
            _ => {
                config.values[0] = first;
                1
            }
        };
        for j in n_read..config.dof() {
            config.values[j] = next(j)?;
        }
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Of every size.
    fn config() -> impl Strategy<Value = JointConfig> {
        prop::collection::vec(-7.0_f32..7.0, 1..=MAX_JOINTS)
            .prop_map(|values| JointConfig::from_slice(&values).unwrap())
    }

    proptest! {
        #[test]
        fn configurations_of_every_size_come_back_from_text(config in config()) {
            let text = serde_json::to_string(&config).unwrap();
            prop_assert_eq!(serde_json::from_str::<Vec<f32>>(&text).unwrap(), config.to_vec());
            prop_assert_eq!(serde_json::from_str::<JointConfig>(&text).unwrap(), config);
        }

        #[test]
        fn seven_joints_are_written_as_before_other_sizes_existed(values in prop::array::uniform7(-7.0_f32..7.0)) {
            let config = JointConfig::new(values);
            prop_assert_eq!(serde_json::to_string(&config).unwrap(), serde_json::to_string(&values).unwrap());
            #[cfg(feature = "sim")]
            {
                let bytes = postcard::to_allocvec(&values).unwrap();
                prop_assert_eq!(&postcard::to_allocvec(&config).unwrap(), &bytes);
                prop_assert_eq!(postcard::from_bytes::<JointConfig>(&bytes).unwrap(), config);
            }
        }

        #[cfg(feature = "sim")]
        #[test]
        fn configurations_of_every_size_come_back_from_bytes(configs in prop::collection::vec(config(), 0..4)) {
            let bytes = postcard::to_allocvec(&configs).unwrap();
            prop_assert_eq!(postcard::from_bytes::<Vec<JointConfig>>(&bytes).unwrap(), configs);
        }
    }

    #[cfg(feature = "sim")]
    #[test]
    fn a_mark_of_too_many_joints_and_bytes_that_end_early_are_errors() {
        let mut bytes = f32::from_bits(MARK | 17).to_le_bytes().to_vec();
        bytes.resize(200, 0);
        assert!(postcard::from_bytes::<JointConfig>(&bytes).is_err());
        let bytes = postcard::to_allocvec(&JointConfig::new([1.0; 8])).unwrap();
        assert!(postcard::from_bytes::<JointConfig>(&bytes[..bytes.len() - 1]).is_err());
    }

    #[test]
    fn text_without_a_joint_or_with_too_many_is_refused() {
        for (n, reason) in [(0, "invalid length 0"), (17, "invalid length 17")] {
            let text = serde_json::to_string(&vec![0.0; n]).unwrap();
            let error = serde_json::from_str::<JointConfig>(&text).unwrap_err().to_string();
            assert!(error.contains(reason) && error.contains("1 to 16"), "{error}");
        }
    }

    #[test]
    fn configurations_of_other_sizes_differ_even_where_both_are_zero() {
        assert_ne!(JointConfig::new([0.0; 7]), JointConfig::new([0.0; 8]));
        assert_eq!(JointConfig::from_slice(&[0.0; 17]), None);
        assert_eq!(JointConfig::new([1.0, 2.0]).to_array(), [1.0, 2.0, 0.0]);
    }
}
