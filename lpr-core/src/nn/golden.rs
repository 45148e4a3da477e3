//! Comparisons of the golden tests of networks.

use super::parameters::NamedTensor;

pub(crate) fn assert_close(what: &str, found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (idx, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f - e).abs() <= tolerance, "{what}[{idx}]: {f}, expected {e}");
    }
}

pub(crate) fn assert_tensors_close(
    found: &[NamedTensor],
    expected: &[NamedTensor],
    tolerance: f32,
) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!((&found.name, &found.shape), (&expected.name, &expected.shape));
        assert_close(&found.name, &found.values, &expected.values, tolerance);
    }
}
