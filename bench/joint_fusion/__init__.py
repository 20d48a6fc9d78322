"""What paper 002 demands of joint fusion: association, classes, time, tracks of tracks."""
