//! Many values of a function, in order.

/// `f(0)`, `f(1)`, … in order, computed by any number of threads.
#[cfg(feature = "parallel")]
pub(crate) fn map_in_order<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};
    (0..n).into_par_iter().map(f).collect()
}

/// `f(0)`, `f(1)`, … in order.
#[cfg(not(feature = "parallel"))]
pub(crate) fn map_in_order<T>(n: usize, f: impl Fn(usize) -> T) -> Vec<T> {
    (0..n).map(f).collect()
}
