"""The common picture: reports of all carriers with a trusted frame, tracks and classes (002)."""
