"""The stages, one room each: functions from values to values, without a folder.

A run goes through them in this order; `pomona.pipeline` declares what each takes and runs them:

    capture        photos with their metadata, from folders or a video
    segment        the fruits in each photo, as masks
    sfm            where each photo was taken
    scale          metres, the world's axes, both sides of the row in one frame
    fuse           masks of all photos joined into fruits
    second_look    every fruit looked at again in all photos that should show it
    filter         which of them are fruits
    measure        diameters, heights, weights
    planting       each fruit on its tree
    dense          coloured points on the fruits
    scene          the whole row as points, to look at
    yields         how many there are, also those that no photo shows
    report         all of it on a page
"""
