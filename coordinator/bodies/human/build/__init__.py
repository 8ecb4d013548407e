"""Builds the file of people's bodies, `person.npz`, from the free data of MakeHuman."""
