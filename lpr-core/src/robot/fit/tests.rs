use super::*;
use crate::rng::{Rng, Stream, stream};
use glamx::Vec3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// Half extents of a box, or radius and half length of a cylinder, with a signed distance.
#[derive(Debug, Clone, Copy)]
enum Convex {
    Cuboid(DVec3),
    Cylinder(f64, f64),
}

impl Convex {
    fn solid(self) -> Solid {
        match self {
            Self::Cuboid(half_extents) => Solid::Cuboid { half_extents },
            Self::Cylinder(radius, half_length) => Solid::Cylinder { radius, half_length },
        }
    }

    /// Distance from the solid, metres; inside, minus the distance from its surface.
    fn signed_distance(self, p: DVec3) -> f64 {
        let beyond = match self {
            Self::Cuboid(half) => p.abs() - half,
            Self::Cylinder(radius, half_length) => {
                DVec3::new(p.truncate().length() - radius, p.z.abs() - half_length, f64::MIN)
            }
        };
        beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0)
    }

    fn surface_point(self, rng: &mut Rng) -> DVec3 {
        let mut unit = || rng.random_range(-1.0..=1.0_f64);
        match self {
            Self::Cuboid(half) => {
                let p = DVec3::new(unit(), unit(), unit());
                half * p / p.abs().max_element()
            }
            Self::Cylinder(radius, half_length) => {
                let (u, v, angle) = (unit(), unit(), 3.2 * unit());
                let (radius, z) = if u.abs() < v.abs() {
                    (radius, u / v.abs())
                } else {
                    (radius * v.abs().sqrt(), u.signum())
                };
                DVec3::new(radius * angle.cos(), radius * angle.sin(), half_length * z)
            }
        }
    }
}

fn is_covered(cover: &Cover, point: DVec3) -> bool {
    cover
        .spheres
        .iter()
        .any(|ball| ball.center.as_dvec3().distance(point) <= f64::from(ball.radius))
}

/// No sphere of a convex solid's cover reaches further than the bound: a ball reaches as far as its
/// centre does, and its radius.
fn assert_within_bound(shape: Convex, cover: &Cover) {
    for ball in &cover.spheres {
        let reach = f64::from(ball.radius) + shape.signed_distance(ball.center.as_dvec3());
        assert!(
            reach <= f64::from(cover.overshoot) + 1e-6,
            "{shape:?}: {ball:?} reaches {reach} m, not {}",
            cover.overshoot
        );
    }
}

fn convex() -> impl Strategy<Value = Convex> {
    let cuboid = [0.002..0.3, 0.002..0.3, 0.002..0.3_f64]
        .prop_map(|half| Convex::Cuboid(DVec3::from_array(half)));
    let cylinder = (0.005..0.2, 0.002..0.4_f64)
        .prop_map(|(radius, half_length)| Convex::Cylinder(radius, half_length));
    prop_oneof![cuboid, cylinder]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn boxes_and_cylinders_are_covered_and_overshot_within_the_bound(shape in convex(), seed in 0_u64..1000) {
        let cover = cover(&shape.solid(), OVERSHOOT).expect("few triangles");
        prop_assert!((1..=MAX_SPHERES).contains(&cover.spheres.len()));
        let mut rng = stream(seed, Stream::Ik, 0);
        for _ in 0..3000 {
            let point = shape.surface_point(&mut rng);
            prop_assert!(shape.signed_distance(point).abs() < 1e-9);
            prop_assert!(is_covered(&cover, point), "{shape:?}: {point}");
        }
        assert_within_bound(shape, &cover);
    }

    #[test]
    fn any_triangles_are_covered(
        corners in prop::collection::vec([-0.2..0.2, -0.2..0.2, -0.2..0.2_f64], 3..15), seed in 0_u64..1000,
    ) {
        let triangles: Vec<Triangle> = corners.windows(3).map(|it| [0, 1, 2].map(|i| DVec3::from_array(it[i]))).collect();
        let cover = cover(&Solid::Mesh { triangles: triangles.clone() }, OVERSHOOT).expect("few triangles");
        prop_assert!((1..=MAX_SPHERES).contains(&cover.spheres.len()));
        let mut rng = stream(seed, Stream::Ik, 0);
        for [a, b, c] in triangles {
            for _ in 0..200 {
                let (u, v) = (rng.random::<f64>(), rng.random::<f64>());
                let point = a + u * (b - a) + (1.0 - u) * v * (c - a);
                prop_assert!(is_covered(&cover, point), "{point}");
            }
        }
    }

    #[test]
    fn capsules_are_covered_and_overshot_within_the_bound(radius in 0.001..0.3_f64, half_length in 1e-4..2.0_f64, seed in 0_u64..1000) {
        let cover = cover(&Solid::Capsule { radius, half_length }, OVERSHOOT).expect("no triangles");
        let distance = |p: DVec3| (p - DVec3::Z * p.z.clamp(-half_length, half_length)).length() - radius;
        let mut rng = stream(seed, Stream::Ik, 0);
        for _ in 0..500 {
            let around = [(); 3].map(|()| rng.random_range(-1.0..1.0));
            let at = DVec3::Z * half_length * rng.random_range(-1.0..=1.0);
            prop_assert!(is_covered(&cover, at + radius * DVec3::from_array(around).normalize_or_zero()));
        }
        let reach = |ball: &Sphere| f64::from(ball.radius) + distance(ball.center.as_dvec3());
        prop_assert!(cover.spheres.iter().all(|ball| reach(ball) <= f64::from(cover.overshoot) + 1e-6));
        prop_assert!(cover.spheres.len() <= MAX_SPHERES);
    }
}

#[test]
fn a_ball_is_itself() {
    let expected =
        Cover { spheres: vec![Sphere { center: Vec3::ZERO, radius: 0.06 }], overshoot: 0.0 };
    assert_eq!(cover(&Solid::Ball { radius: 0.06 }, OVERSHOOT), Ok(expected));
}

#[test]
fn links_of_usual_size_overshoot_by_no_more_than_is_asked_for() {
    let upper_arm = Convex::Cylinder(0.06, 0.15);
    let hand = Convex::Cuboid(DVec3::new(0.03, 0.1, 0.035));
    for shape in [upper_arm, hand] {
        let mut n_before = usize::MAX;
        for overshoot in [0.008, OVERSHOOT, 0.03] {
            let cover = cover(&shape.solid(), overshoot).expect("few triangles");
            let (found, n) = (f64::from(cover.overshoot), cover.spheres.len());
            assert!(found <= 1.001 * overshoot, "{shape:?}: {found} m with {n}");
            assert!(n < n_before, "{shape:?}: {n} spheres for {overshoot} m");
            n_before = n;
        }
        assert!(n_before <= FEW_SPHERES);
    }
}

/// An L of two boxes: its inner corner stays free, which no convex hull leaves free.
#[test]
fn a_mesh_with_an_elbow_keeps_its_inner_corner_free() {
    let moved = |half_extents, by: DVec3| {
        cuboid(half_extents).into_iter().map(move |triangle| triangle.map(|p| p + by))
    };
    let parts = [
        (DVec3::new(0.04, 0.04, 0.15), DVec3::ZERO),
        (DVec3::new(0.1, 0.04, 0.04), DVec3::new(0.14, 0.0, -0.11)),
    ];
    let triangles = parts.iter().flat_map(|(half_extents, by)| moved(*half_extents, *by)).collect();
    let cover = cover(&Solid::Mesh { triangles }, OVERSHOOT).expect("few triangles");
    let distance = |p: DVec3| {
        parts
            .map(|(half, at)| Convex::Cuboid(half).signed_distance(p - at))
            .into_iter()
            .fold(f64::MAX, f64::min)
    };
    let mut rng = stream(1, Stream::Ik, 0);
    for ball in &cover.spheres {
        for _ in 0..1000 {
            let around = DVec3::from_array([(); 3].map(|()| rng.random_range(-1.0..1.0)));
            let beyond = distance(
                ball.center.as_dvec3() + f64::from(ball.radius) * around.normalize_or_zero(),
            );
            assert!(beyond <= f64::from(cover.overshoot), "{ball:?} reaches {beyond} m");
        }
    }
    assert!(!is_covered(&cover, DVec3::new(0.1, 0.0, 0.03)));
    assert!(
        is_covered(&cover, DVec3::ZERO) && is_covered(&cover, DVec3::new(0.2, 0.0, -0.11)),
        "the inside is covered, too"
    );
    assert!(cover.overshoot < 0.035, "{} m", cover.overshoot);
}

#[test]
fn a_mesh_without_thickness_or_extent_is_covered() {
    let flat = Solid::Mesh { triangles: vec![[DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 0.1]] };
    let point = Solid::Mesh { triangles: vec![[DVec3::X; 3]] };
    assert!(
        cover(&flat, OVERSHOOT).is_ok_and(|cover| is_covered(&cover, DVec3::new(0.05, 0.05, 0.0)))
    );
    assert!(
        cover(&point, OVERSHOOT)
            .is_ok_and(|cover| is_covered(&cover, DVec3::X) && cover.spheres.len() == 1)
    );
}

#[test]
fn the_largest_and_the_flattest_shapes_are_covered_in_the_end() {
    for half_extents in [
        DVec3::new(500.0, 1e-6, 1e-6),
        DVec3::new(500.0, 500.0, 1e-6),
        DVec3::splat(500.0),
        DVec3::splat(1e-7),
    ] {
        let cover = cover(&Solid::Cuboid { half_extents }, OVERSHOOT).expect("few triangles");
        assert!(
            is_covered(&cover, half_extents) && cover.spheres.len() <= MAX_SPHERES,
            "{half_extents}"
        );
        assert_within_bound(Convex::Cuboid(half_extents), &cover);
    }
}

#[test]
fn a_mesh_that_asks_for_too_many_samples_is_refused() {
    let sliver = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1e-3, 0.0)];
    let message = cover(&Solid::Mesh { triangles: vec![sliver; 5000] }, OVERSHOOT)
        .expect_err("five thousand large triangles");
    assert!(message.contains("5000 triangles"), "{message}");
}
