"""From a configuration to a measured session."""
