"""What clients need of a front is measured before it can be published."""
