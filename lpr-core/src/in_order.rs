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

/// Calls `f` on each item, with memory from `scratch` that the items of one thread share.
#[cfg(all(feature = "parallel", feature = "learn"))]
pub(crate) fn each_with_scratch<T: Send, M>(
    items: Vec<T>,
    scratch: impl Fn() -> M + Sync + Send,
    f: impl Fn(&mut M, T) + Sync + Send,
) {
    use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};
    items.into_par_iter().for_each_init(scratch, f);
}

/// Calls `f` on each item, with memory from `scratch` that all share.
#[cfg(all(not(feature = "parallel"), feature = "learn"))]
pub(crate) fn each_with_scratch<T, M>(
    items: Vec<T>,
    scratch: impl Fn() -> M,
    f: impl Fn(&mut M, T),
) {
    let mut memory = scratch();
    items.into_iter().for_each(|item| f(&mut memory, item));
}
