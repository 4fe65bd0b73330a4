% Load a survey in the form that the authors' program reads, and print what is in it, a line a file: name, counts.
%
%   octave-cli --eval "addpath('benchmarks/octave'); smoke('FOLDER')"      FOLDER holds data/
%
% Files are read as that program reads them: dlmread, fscanf, load.
function smoke (folder)
  data = fullfile (folder, "data");
  cameras = dir (fullfile (data, "camaras", "*_cameras.out"));
  for i = 1:numel (cameras)
    table = dlmread (fullfile (data, "camaras", cameras(i).name), " ", 1, 0);
    rows = size (table, 1) - 1 - 5 * table(1, 1);
    printf ("%s cameras %d tie points %d\n", cameras(i).name, table(1, 1), rows / 3);
  end
  clouds = dir (fullfile (data, "pt_clouds", "*_pc.txt"));
  for i = 1:numel (clouds)
    id = fopen (fullfile (data, "pt_clouds", clouds(i).name), "r");
    points = fscanf (id, "%f %f %f %d %d %d", [6 Inf])';
    fclose (id);
    printf ("%s points %d\n", clouds(i).name, size (points, 1));
  end
  sides = dir (fullfile (data, "masks", "*_masks"));
  for i = 1:numel (sides)
    files = dir (fullfile (data, "masks", sides(i).name, "*.mat"));
    labels = 0;
    for j = 1:numel (files)
      content = load (fullfile (data, "masks", sides(i).name, files(j).name));
      if numel (content.scores) < max (content.mask(:))
        error ("%s: fewer scores than labels", files(j).name);
      end
      labels = labels + double (max (content.mask(:)));
    end
    printf ("%s masks %d labels %d\n", sides(i).name, numel (files), labels);
  end
end
