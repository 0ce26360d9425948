//! The real firmware binary of the RCG under test.
//!
//! What is tested here is the ELF file that would be flashed. So far its image is checked; running it is the
//! next step, see the README beside this.
