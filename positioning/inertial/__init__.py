"""Navigation by inertial sensors and odometers: the earth, and the mechanisation of wheeled vehicles."""
