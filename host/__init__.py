"""The host receiver: records, checks and draws what a navigation board sends on its serial line."""
