//! The library as a native program; `run.cjs` is the same in Node.

fn main() -> Result<(), String> {
    println!("{}", user::plan());
    let shares: Vec<_> = user::learn()?.iter().map(|share| format!("{share:.2}")).collect();
    println!("{}", shares.join(" "));
    Ok(())
}
