//! Reads run directories and draws; computes nothing new.
