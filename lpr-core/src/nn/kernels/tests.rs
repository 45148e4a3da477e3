use super::dense;
use super::matmul::{Activation, Matrix, accumulate, multiply, multiply_transposed, transposed};
use super::pooled;
use super::tiles::{Padding, Tiles};
use super::winograd;
use crate::lanes::levels;
use crate::rng::{Rng, Stream, stream};

use fearless_simd::Level;
use rand::RngExt as _;

const ACTIVATIONS: [Activation; 3] =
    [Activation::Linear, Activation::Relu, Activation::Leaky { slope: 0.02 }];

fn rng() -> Rng {
    stream(0, Stream::Noise, 0)
}

fn random(n: usize, rng: &mut Rng) -> Vec<f32> {
    (0..n).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn assert_near(what: &str, found: &[f32], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(1.0_f64, |most, value| most.max(value.abs()));
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(*found) - expected).abs();
        assert!(error <= 3e-6 * scale, "{what}[{i}]: {found}, expected {expected}");
    }
}

fn activated(activation: Activation, x: f64) -> f64 {
    match activation {
        Activation::Linear => x,
        Activation::Relu => x.max(0.0),
        Activation::Leaky { slope } => x.max(f64::from(slope) * x),
    }
}

/// `a b`, one sum after the other.
fn product(a: &[f32], b: &[f32], [m, k, n]: [usize; 3]) -> Vec<f64> {
    let entry = |i: usize, j: usize| {
        (0..k).map(|l| f64::from(a[i * k + l]) * f64::from(b[l * n + j])).sum()
    };
    (0..m).flat_map(|i| (0..n).map(move |j| entry(i, j))).collect()
}

#[test]
fn products_are_the_sums_at_every_level() {
    let rng = &mut rng();
    for [m, k, n] in [[1, 1, 1], [5, 3, 2], [15, 10, 33], [16, 9, 16], [29, 75, 47], [40, 32, 64]] {
        let (a, b, bias) = (random(m * k, rng), random(k * n, rng), random(n, rng));
        let right = Matrix::new(&b, k, n);
        for level in levels() {
            for activation in ACTIVATIONS {
                let mut c = vec![f32::NAN; m * n];
                multiply(level, Matrix::new(&a, m, k), right, Some(&bias), activation, &mut c);
                let expected = product(&a, &b, [m, k, n]);
                let sums = expected.iter().enumerate();
                let expected = sums
                    .map(|(i, sum)| activated(activation, sum + f64::from(bias[i % n])))
                    .collect::<Vec<_>>();
                assert_near(&format!("{m} x {k} x {n}, {level:?}"), &c, &expected);
            }
            let b_transposed = transposed(&b, k, n);
            let mut c = vec![f32::NAN; m * n];
            let right = Matrix::new(&b_transposed, n, k);
            multiply_transposed(level, Matrix::new(&a, m, k), right, &mut c);
            assert_near("a bT", &c, &product(&a, &b, [m, k, n]));

            let a_transposed = transposed(&a, m, k);
            let mut c = vec![1.0; m * n];
            accumulate(level, Matrix::new(&a_transposed, k, m), Matrix::new(&b, k, n), &mut c);
            let expected = product(&a, &b, [m, k, n]).into_iter().map(|sum| sum + 1.0);
            assert_near("1 + a b", &c, &expected.collect::<Vec<_>>());
        }
    }
}

#[test]
fn a_row_has_the_same_bits_beside_any_others() {
    let rng = &mut rng();
    let [m, k, n] = [50, 37, 41];
    let (a, b) = (random(m * k, rng), random(k * n, rng));
    for level in levels() {
        let product = |rows: usize| {
            let mut c = vec![0.0; rows * n];
            let left = Matrix::new(&a[..rows * k], rows, k);
            multiply(level, left, Matrix::new(&b, k, n), None, Activation::Linear, &mut c);
            c
        };
        let all = product(m);
        for rows in 1..m {
            assert_eq!(product(rows), all[..rows * n], "{rows} rows, {level:?}");
        }
    }
}

/// Outputs and the gradients of input, weights and bias of a convolution, sum after sum.
struct Naive {
    y: Vec<f64>,
    dx: Vec<f64>,
    dw: Vec<f64>,
}

fn convolution(
    near: &[[Option<usize>; 27]],
    [x, w, bias, dy]: [&[f32]; 4],
    [c_in, c_out]: [usize; 2],
) -> Naive {
    let n_cells = near.len();
    let mut naive =
        Naive { y: vec![0.0; dy.len()], dx: vec![0.0; x.len()], dw: vec![0.0; w.len()] };
    for row in 0..dy.len() / c_out {
        let base = row / n_cells * n_cells;
        for (tap, cell) in near[row % n_cells].iter().enumerate() {
            let Some(cell) = cell else { continue };
            for i in 0..c_in {
                let input = (base + cell) * c_in + i;
                for o in 0..c_out {
                    let (weight, output) = ((tap * c_in + i) * c_out + o, row * c_out + o);
                    naive.y[output] += f64::from(x[input]) * f64::from(w[weight]);
                    naive.dx[input] += f64::from(dy[output]) * f64::from(w[weight]);
                    naive.dw[weight] += f64::from(dy[output]) * f64::from(x[input]);
                }
            }
        }
        for (y, bias) in naive.y[row * c_out..(row + 1) * c_out].iter_mut().zip(bias) {
            *y += f64::from(*bias);
        }
    }
    naive
}

/// The neighbours of a grid in raster order.
fn near_in_raster(
    [depth, height, width]: [usize; 3],
    padding: Padding,
) -> Vec<[Option<usize>; 27]> {
    let cell = |at: [usize; 3], tap: usize| {
        let mut row = 0;
        for (axis, n) in [depth, height, width].into_iter().enumerate() {
            let moved = at[axis] as isize + [tap / 9, tap / 3 % 3, tap % 3][axis] as isize - 1;
            let clamped = moved.clamp(0, n as isize - 1);
            if moved != clamped && padding == Padding::Zero {
                return None;
            }
            row = row * n + clamped as usize;
        }
        Some(row)
    };
    (0..depth * height * width)
        .map(|i| {
            let at = [i / (height * width), i / width % height, i % width];
            core::array::from_fn(|tap| cell(at, tap))
        })
        .collect()
}

#[test]
fn winograds_convolution_and_its_gradients_are_the_sums_at_every_level() {
    let rng = &mut rng();
    for (dims, padding, [c_in, c_out], n) in [
        ([4, 4, 4], Padding::Replicate, [8, 16], 2),
        ([3, 4, 5], Padding::Zero, [5, 7], 2),
        ([3, 4, 5], Padding::Replicate, [10, 33], 1),
        ([6, 2, 7], Padding::Zero, [17, 3], 3),
        ([1, 1, 1], Padding::Replicate, [2, 1], 3),
        ([8, 8, 8], Padding::Replicate, [32, 32], 1),
    ] {
        let n_cells = dims.iter().product::<usize>();
        let tiles = Tiles::raster(dims, padding);
        let near = near_in_raster(dims, padding);
        assert_eq!(tiles.neighbours(), near, "{dims:?}");
        let (x, w) = (random(n * n_cells * c_in, rng), random(27 * c_in * c_out, rng));
        let (bias, dy) = (random(c_out, rng), random(n * n_cells * c_out, rng));
        let expected = convolution(&near, [&x, &w, &bias, &dy], [c_in, c_out]);
        for level in levels() {
            let layer = winograd::Layer {
                tiles: &tiles,
                channels_in: c_in,
                channels_below: 0,
                channels_out: c_out,
                activation: Activation::Linear,
            };
            let what = format!("{dims:?}, {c_in} to {c_out}, {level:?}");
            assert_near(&what, &winograd::forward(level, layer, [&x, &[]], &w, &bias), &expected.y);
            let slices = [&x[..], &[], &w, &dy, &dy];
            let (gradients, _) = winograd::backward(level, layer, slices, true);
            assert_near(&what, &gradients.x.expect("asked for"), &expected.dx);
            assert_near(&what, &gradients.weights, &expected.dw);
            let (without, below) = winograd::backward(level, layer, slices, false);
            assert!(without.x.is_none() && below.is_none());
            assert_eq!(without.weights, gradients.weights);
        }
    }
}

/// The channels of a block of eight rows are those of each of its cells.
#[test]
fn a_convolution_beside_the_grid_below_is_that_of_the_joined_cells_at_every_level() {
    let rng = &mut rng();
    let ([own, below, c_out], n_cells) = ([16, 21, 35], 64);
    let total = own + below;
    // 4³ cells in blocks of 2³.
    let rows = (0..n_cells).map(|i| {
        let [z, y, x] = [i / 16, i / 4 % 4, i % 4];
        ((z / 2 * 2 + y / 2) * 2 + x / 2) * 8 + (z % 2 * 2 + y % 2) * 2 + x % 2
    });
    let rows = rows.collect::<Vec<_>>();
    let (x, of_blocks) = (random(2 * n_cells * own, rng), random(2 * n_cells / 8 * below, rng));
    let (w, bias) = (random(27 * total * c_out, rng), random(c_out, rng));
    let dy = random(2 * n_cells * c_out, rng);
    let joined = x.chunks_exact(own).enumerate();
    let joined = joined
        .flat_map(|(row, own)| [own, &of_blocks[row / 8 * below..][..below]].concat())
        .collect::<Vec<_>>();
    for padding in [Padding::Zero, Padding::Replicate] {
        let tiles = Tiles::in_order([4; 3], padding, &rows);
        let near = tiles.neighbours();
        let expected = convolution(&near, [&joined, &w, &bias, &dy], [total, c_out]);
        let (mut dx, mut dbelow) = (Vec::new(), vec![0.0; of_blocks.len()]);
        for (row, gradient) in expected.dx.chunks_exact(total).enumerate() {
            dx.extend_from_slice(&gradient[..own]);
            for (sum, value) in dbelow[row / 8 * below..][..below].iter_mut().zip(&gradient[own..])
            {
                *sum += value;
            }
        }
        for level in levels() {
            let layer = winograd::Layer {
                tiles: &tiles,
                channels_in: own,
                channels_below: below,
                channels_out: c_out,
                activation: Activation::Linear,
            };
            let y = winograd::forward(level, layer, [&x, &of_blocks], &w, &bias);
            assert_near("output", &y, &expected.y);
            let slices = [&x[..], &of_blocks, &w, &dy, &dy];
            let (gradients, of_blocks) = winograd::backward(level, layer, slices, true);
            assert_near("cells", &gradients.x.expect("asked for"), &dx);
            assert_near("blocks", &of_blocks.expect("asked for"), &dbelow);
            assert_near("weights", &gradients.weights, &expected.dw);
        }
    }
}

#[test]
fn the_order_of_the_cells_changes_no_value() {
    let rng = &mut rng();
    let (dims, [c_in, c_out]) = ([4, 6, 4], [3, 5]);
    let n_cells = dims.iter().product::<usize>();
    // The rows in reverse, which is no order of tiles.
    let rows = (0..n_cells).rev().collect::<Vec<_>>();
    let (x, w, bias) = (random(n_cells * c_in, rng), random(27 * 15, rng), random(c_out, rng));
    let reversed = |x: &[f32], channels: usize| {
        x.chunks(channels).rev().flatten().copied().collect::<Vec<_>>()
    };
    let convolved = |tiles: &Tiles, x: &[f32]| {
        let layer = winograd::Layer {
            tiles,
            channels_in: c_in,
            channels_below: 0,
            channels_out: c_out,
            activation: Activation::Relu,
        };
        winograd::forward(Level::new(), layer, [x, &[]], &w, &bias)
    };
    let raster = convolved(&Tiles::raster(dims, Padding::Replicate), &x);
    let tiles = Tiles::in_order(dims, Padding::Replicate, &rows);
    assert_eq!(reversed(&convolved(&tiles, &reversed(&x, c_in)), c_out), raster);
}

#[test]
fn what_is_not_a_number_stays_so() {
    let tiles = Tiles::raster([2; 3], Padding::Replicate);
    for activation in ACTIVATIONS {
        let layer = winograd::Layer {
            tiles: &tiles,
            channels_in: 1,
            channels_below: 0,
            channels_out: 1,
            activation,
        };
        let mut x = [1.0; 8];
        x[3] = f32::NAN;
        let y = winograd::forward(Level::new(), layer, [&x, &[]], &[0.1; 27], &[0.0]);
        assert!(y.iter().all(|value| value.is_nan()), "{y:?}");
        let layer = dense::Layer { inputs: 8, outputs: 1, activation };
        let y = dense::forward(Level::new(), layer, &x, &[0.1; 8], &[0.0]);
        assert!(y[0].is_nan());
        let maxima = pooled::forward(Level::new(), layer, 1, [&x, &[0.1; 8], &[0.0]]);
        assert!(maxima.values[0].is_nan());
        // One of eight members of a set.
        let layer = dense::Layer { inputs: 1, outputs: 1, activation };
        let maxima = pooled::forward(Level::new(), layer, 8, [&x, &[0.1], &[0.0]]);
        assert!(maxima.values[0].is_nan() && maxima.members[0] == 3);
    }
}

#[test]
fn maxima_and_their_gradients_are_those_of_the_whole_layer() {
    let rng = &mut rng();
    let (n_sets, members, inputs, outputs) = (3, 30, 7, 37);
    let mut x = random(n_sets * members * inputs, rng);
    // Two members that are alike: the first counts.
    x.copy_within(2 * inputs..3 * inputs, 9 * inputs);
    let (w, bias) = (random(inputs * outputs, rng), random(outputs, rng));
    let dy = random(n_sets * outputs, rng);
    for level in levels() {
        for activation in ACTIVATIONS {
            let layer = dense::Layer { inputs, outputs, activation };
            let maxima = pooled::forward(level, layer, members, [&x, &w, &bias]);
            let all = dense::forward(level, layer, &x, &w, &bias);
            let mut whole = vec![0.0; all.len()];
            for (i, (&value, &member)) in maxima.values.iter().zip(&maxima.members).enumerate() {
                let (set, output) = (i / outputs, i % outputs);
                let of = |member: usize| all[(set * members + member) * outputs + output];
                let largest = (0..members).map(of).fold(f32::NEG_INFINITY, f32::max);
                assert_eq!((value, of(member as usize)), (largest, largest));
                if activation == Activation::Linear {
                    assert!((0..member as usize).all(|earlier| of(earlier) < largest));
                }
                whole[(set * members + member as usize) * outputs + output] = dy[i];
            }
            let expected = dense::backward(level, layer, [&x, &w, &all, &whole], true);
            let found = pooled::backward(level, layer, members, [&x, &w, &dy], &maxima, true);
            let wide = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
            let [found_x, expected_x] = [found.x, expected.x].map(|x| x.expect("asked for"));
            assert_near("input", &found_x, &wide(&expected_x));
            assert_near("weights", &found.weights, &wide(&expected.weights));
            assert_near("bias", &found.bias, &wide(&expected.bias));
        }
    }
}

#[cfg(feature = "parallel")]
#[test]
fn one_and_more_threads_give_the_same_bits() {
    let rng = &mut rng();
    let tiles = Tiles::raster([8; 3], Padding::Replicate);
    let layer = winograd::Layer {
        tiles: &tiles,
        channels_in: 32,
        channels_below: 0,
        channels_out: 48,
        activation: Activation::Relu,
    };
    let (x, w, bias) = (random(4 * 512 * 32, rng), random(27 * 32 * 48, rng), random(48, rng));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| winograd::forward(Level::new(), layer, [&x, &[]], &w, &bias))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}
