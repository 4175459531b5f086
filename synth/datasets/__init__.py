"""Generate and verify data sets, and compare their motion with recordings."""
