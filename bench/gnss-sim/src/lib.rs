//! Simulated delivery flights and the u-blox receivers that see them
