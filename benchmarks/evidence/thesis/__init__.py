"""The findings of [Sahbaz 2007] about its tracking laws, held against the emulated rig."""
