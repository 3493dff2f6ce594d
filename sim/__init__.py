"""The drive-train simulator and what it gets wrong."""
